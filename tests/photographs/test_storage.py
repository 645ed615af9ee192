from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from matest.photographs.storage import Storage, release
from tests.captures import refusal

# Stores a megabyte beyond the budget, and prints the refusal.
STORE = """
from matest.errors import InputError
from matest.photographs import storage
import numpy as np
storage.MEMORY_BUDGET = 0
try:
    storage.Storage().keep(np.ones(1 << 20, np.uint8))
except InputError as error:
    print(error)
"""


@pytest.fixture
def little_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder that holds 64 KiB."""
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", tmp_path], capture_output=True)
    if mounted.returncode:
        pytest.skip("this user may not mount a small disk")
    yield tmp_path
    subprocess.run(["umount", tmp_path], check=True)


def test_arrays_within_the_budget_are_kept_as_they_are() -> None:
    array = np.arange(6.0)
    assert Storage().keep(array) is array


def test_arrays_beyond_the_budget_are_mapped_and_read_again_after_their_release(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("matest.photographs.storage.MEMORY_BUDGET", 100)
    storage, arrays = Storage(), [np.full((5, 3), k, np.float32) for k in range(3)]
    kept = [storage.keep(array) for array in arrays]
    assert [isinstance(array, np.memmap) for array in kept] == [False, True, True]
    for array, original in zip(kept, arrays, strict=True):
        release(array)
        np.testing.assert_array_equal(array, original)


def test_arrays_too_large_for_the_temporary_folder_are_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    resource = pytest.importorskip("resource", reason="this system has no limit of the size of files")
    monkeypatch.setattr("matest.photographs.storage.MEMORY_BUDGET", 0)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 12, hard))
    try:
        message = refusal(lambda: Storage().keep(np.ones(1 << 16, np.uint8)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert message.startswith(f"{tmp_path}: ")
    assert "TMPDIR" in message


@pytest.mark.skipif(sys.platform != "linux", reason="small disks are mounted as Linux does")
def test_a_full_disk_does_not_kill_the_process(little_disk: Path) -> None:
    environment = {**os.environ, "TMPDIR": str(little_disk)}
    stored = subprocess.run([sys.executable, "-c", STORE], env=environment, capture_output=True)
    assert stored.returncode == 0
    assert stored.stdout.decode().startswith(f"{little_disk}: ")
