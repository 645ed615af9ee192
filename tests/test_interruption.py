"""Signals that ask to end: within two seconds, whatever a library is at."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path

import pytest

from tests.signalled import hearing

# A call of a library that no signal interrupts, with a place that is not whole and another process that has its own.
STUCK = """
import hashlib, multiprocessing, sys, time
from pathlib import Path
from matest import interruption
from matest.places import sweep, whole_folder

def write(place):
    with whole_folder(place):
        (place.parent / "writing").touch()
        time.sleep(100)

if __name__ == "__main__":
    mine, others = Path(sys.argv[1], "mine"), Path(sys.argv[1], "others")
    multiprocessing.get_context("fork").Process(target=write, args=(others,)).start()
    while not (others.parent / "writing").exists():
        time.sleep(0.01)
    with (
        interruption.watched(), interruption.sentence(lambda: "3 of 4 are complete.", lambda: sweep(others)),
        whole_folder(mine),
    ):
        print("here", flush=True)
        hashlib.pbkdf2_hmac("sha256", b"", b"", 1_000_000_000)
"""


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_a_process_that_does_not_hear_ends_and_takes_along_what_is_not_whole(tmp_path: Path, kind: int) -> None:
    command = [sys.executable, "-c", STUCK, str(tmp_path)]
    with hearing(command) as process:
        assert process.stdout is not None
        process.stdout.readline()
        # Until the call has begun.
        time.sleep(0.3)
        begin = time.monotonic()
        process.send_signal(kind)
        _, err = process.communicate(timeout=20)
    assert process.returncode == 1
    assert err == "matest: 3 of 4 are complete.\n"
    assert time.monotonic() - begin < 5
    assert [path.name for path in tmp_path.iterdir()] == ["writing"]
