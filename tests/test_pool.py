"""Processes side by side: every item has its result, whatever dies."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from matest import pool
from matest.pool import Lost, in_processes, limited_memory


def work(item: tuple[str, str]) -> tuple[int, str]:
    """What an item asks for: to die, to die unless a file is there, or to tell the process."""
    what, file = item
    if what == "dies" or (what == "dies once" and not Path(file).exists()):
        Path(file).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid(), os.environ["OMP_NUM_THREADS"]


def test_who_dies_is_replaced_and_an_item_that_kills_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pool, "MOST_DEATHS", 2)
    monkeypatch.setattr(pool, "processors", lambda: 3)
    items = [("dies once", str(tmp_path / "once")), ("lives", ""), ("dies", str(tmp_path / "always"))]
    results = dict(in_processes(work, items, 1, 2 << 30))
    assert results[items[2]] == Lost("its process was ended by SIGKILL")
    (first, threads), (second, _) = results[items[0]], results[items[1]]  # type: ignore[misc]
    # One process in its whole life, of as many threads as there are processors for it.
    assert first == second != os.getpid()
    assert threads == "3"


def test_memory_is_limited_inside_and_as_before_afterwards() -> None:
    before = resource.getrlimit(resource.RLIMIT_DATA)
    with limited_memory(None):
        assert resource.getrlimit(resource.RLIMIT_DATA) == before
    with limited_memory(1 << 40):
        assert resource.getrlimit(resource.RLIMIT_DATA)[0] == 1 << 40
    assert resource.getrlimit(resource.RLIMIT_DATA) == before


# Threads that find no memory before they have begun.
FAILING = """
import threading
from matest.pool import limited_memory
from matest.workers import in_threads

def fail(self):
    raise MemoryError

threading.Thread._bootstrap_inner = fail
with limited_memory(4 << 30):
    try:
        print(list(in_threads(str, [1])))
    except MemoryError:
        print("too little")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the memory of a process")
def test_a_thread_without_memory_to_begin_is_not_waited_for() -> None:
    done = subprocess.run([sys.executable, "-c", FAILING], capture_output=True, text=True, timeout=300, check=True)
    assert (done.stdout, done.stderr) == ("too little\n", "")
