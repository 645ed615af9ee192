from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from matest.capture.digests import digested
from tests.captures import refusal


def test_the_digest_is_that_of_the_bytes_that_the_block_reads(tmp_path: Path) -> None:
    file, digests = tmp_path / "00.png", dict[Path, str]()
    file.write_bytes(b"pixels")
    with digested([file, tmp_path / "missing.png"], digests):
        content = file.read_bytes()
    assert digests == {file: "sha256:" + hashlib.sha256(content).hexdigest()}


@pytest.mark.parametrize("change", ["written", "replaced"])
def test_a_file_that_changes_meanwhile_is_refused(tmp_path: Path, change: str) -> None:
    file, other = tmp_path / "00.png", tmp_path / "01.png"
    file.write_bytes(b"pixels")
    other.write_bytes(b"others")
    # Long ago: the clock of a file system may not tell two moments of a test apart.
    os.utime(file, (0, 0))

    def read() -> None:
        with digested([file], {}):
            file.read_bytes()
            if change == "written":
                file.write_bytes(b"others")
            else:
                os.replace(other, file)

    assert refusal(read).startswith(f"{file}: ")
