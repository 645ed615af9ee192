"""Ctrl-C and requests to end: what is half done is removed, and the process ends within two seconds."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

from matest.errors import WORK_FAILED

SENTENCE = "interrupted; what was not finished was not written."
# What the process says in place of that, where there is more to say.
_sentence: Callable[[], str] | None = None
# Removes what other processes left that have been ended by force.
_removal: Callable[[], None] | None = None
# Whether a signal came that asks to end.
_came = threading.Event()
# Folders that are not whole yet, and files that say so: a process that is ended by force removes them.
UNFINISHED: set[Path] = set()
# Signals that ask to end: by a scheduler or the system, and when a terminal goes.
_ENDS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
# Seconds from a signal to the end by force: a call into a library may take longer, and Python waits for it.
_PATIENCE = 1.2
# Seconds in which other processes are gone that were ended by force.
_GRACE = 0.2


@contextlib.contextmanager
def watched() -> Iterator[None]:
    """Signals that ask to end raise KeyboardInterrupt inside, and soon after one the process ends in any case."""
    for kind in _ENDS:
        # What is ignored, as by nohup, stays so.
        if signal.getsignal(kind) is signal.SIG_DFL:
            signal.signal(kind, _interrupt)
    seen, told = os.pipe()
    os.set_blocking(told, False)
    # The system writes there at once, while Python itself hears of a signal only between two of its own steps.
    before = signal.set_wakeup_fd(told)
    threading.Thread(target=_end_after, args=(seen,), daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(told)


@contextlib.contextmanager
def sentence(words: Callable[[], str], removal: Callable[[], None] | None = None) -> Iterator[None]:
    """What to say where the process is ended by force inside.

    Args:
        words: gives the sentence.
        removal: removes what other processes left, which are ended before.
    """
    global _sentence, _removal
    _sentence, _removal = words, removal
    try:
        yield
    finally:
        _sentence = _removal = None


def leave() -> None:
    """Ignore signals from now on, for the work has ended; where one came before, end without taking Python apart."""
    for kind in (signal.SIGINT, *_ENDS):
        signal.signal(kind, signal.SIG_IGN)
    if _came.is_set():
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
        os._exit(WORK_FAILED)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    """End as Ctrl-C does: what is half done is removed."""
    raise KeyboardInterrupt


def _end_after(seen: int) -> None:
    """End the process by force some time after a signal; do nothing where none came."""
    came = os.read(seen, 1)
    os.close(seen)
    if not came:
        return
    _came.set()
    time.sleep(_PATIENCE)
    # Who uses no processes has not loaded what starts them.
    processes = sys.modules.get("multiprocessing")
    children = processes.active_children() if processes else []
    for child in children:
        child.kill()
    for path in list(UNFINISHED):
        shutil.rmtree(path, ignore_errors=True)
        with contextlib.suppress(OSError):
            path.unlink()
    for child in children:
        child.join(_GRACE)
    if _removal is not None:
        _removal()
    with contextlib.suppress(OSError, ValueError):
        print(f"matest: {_sentence() if _sentence else SENTENCE}", file=sys.stderr, flush=True)
    os._exit(WORK_FAILED)
