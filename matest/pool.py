"""Processes that do jobs one after the other, and survive the death of any of them."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from types import FrameType
from typing import Any, Generic, TypeVar

from matest.errors import InputError, WorkError
from matest.workers import limit_processors, processors

Item = TypeVar("Item")
Result = TypeVar("Result")

# Processes that may die of a job before it is given up: the first may have been killed by mistake.
MOST_DEATHS = 3
# Seconds that processes have to remove what is half done; an interrupted command ends within two.
_GRACE = 0.6
# Seconds after which a thread tells again what the main thread has not heard.
_AGAIN = 0.05
# Libraries read from these how many threads to start.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Lost:
    """In place of the result of a job of which every process died.

    Attributes:
        reason: how the last one ended, as a clause.
    """

    reason: str


def in_processes(
    function: Callable[[Item], Result],
    items: Iterable[Item],
    count: int,
    memory: int | None = None,
    threads: int | None = None,
) -> Iterator[tuple[Item, Result | Lost]]:
    """Every item with the result of a function, as they are done, from fresh processes.

    Each process starts once, and a new one takes the place of one that died. When the iteration ends early, so do
    the processes, within a second.

    Args:
        function: that can be pickled, as the items and results can.
        items: any number.
        count: of the processes, at most.
        memory: bytes that each process may have; None: any number.
        threads: of each process; None: the processors are shared.

    Raises:
        WorkError: processes do not start.
    """
    waiting = deque(_Task(item) for item in items)
    share = threads or max(processors() // count, 1)
    crew: list[_Process[Item, Result]] = []
    try:
        while waiting or any(process.task for process in crew):
            idle = [process for process in crew if process.task is None]
            while waiting and (idle or len(crew) < count):
                if not idle:
                    idle.append(_Process(function, share, memory))
                    crew += idle
                idle.pop().begin(waiting.popleft())
            busy = {process.pipe: (process, process.task) for process in crew if process.task}
            for process, task in [busy[pipe] for pipe in wait([*busy]) if isinstance(pipe, Connection)]:
                try:
                    for result in process.received():
                        yield task.item, result
                except EOFError:
                    crew.remove(process)
                    reason = process.burial()
                    task.deaths += 1
                    if task.deaths < MOST_DEATHS:
                        waiting.appendleft(task)
                    elif not process.started:
                        raise WorkError(f"processes for the captures do not start: {reason}.") from None
                    else:
                        yield task.item, Lost(reason)
    finally:
        _dismiss(crew)


@dataclass
class _Task(Generic[Item]):
    item: Item
    deaths: int = 0


class _Process(Generic[Item, Result]):
    """A process and the task that it is at."""

    def __init__(self, function: Callable[[Item], Result], share: int, memory: int | None) -> None:
        self.task: _Task[Item] | None = None
        self.pipe, theirs = multiprocessing.Pipe()
        self.process = multiprocessing.get_context("spawn").Process(
            target=_serve, args=(theirs, function, share, memory), daemon=True
        )
        with _signals_held(), _threads(share):
            self.process.start()
        theirs.close()
        self.started = False

    def begin(self, task: _Task[Item]) -> None:
        self.task = task
        # Where the process has died, nothing comes back either.
        with contextlib.suppress(OSError):
            self.pipe.send(task.item)

    def received(self) -> tuple[Result, ...]:
        """The result of the task, which is then done; nothing where the process only tells that it has started.

        Raises:
            EOFError: the process died.
        """
        try:
            results = self.pipe.recv()
        except OSError:
            raise EOFError from None
        self.started = True
        if results:
            self.task = None
        return results

    def burial(self) -> str:
        """How the process ended."""
        self.pipe.close()
        self.process.join()
        code = self.process.exitcode or 0
        return (
            f"its process was ended by {signal.Signals(-code).name}" if code < 0 else f"its process ended with {code}"
        )


def _dismiss(crew: Iterable[_Process]) -> None:
    """End processes: when they have removed what is half done, or else by force."""
    crew = list(crew)
    for process in crew:
        process.pipe.close()
        # One that still starts has nothing to remove, and would hear late.
        (process.process.terminate if process.started else process.process.kill)()
    end = time.monotonic() + _GRACE
    for process in crew:
        process.process.join(max(end - time.monotonic(), 0))
        process.process.kill()
        process.process.join()


def _serve(pipe: Connection, function: Callable[[Any], Any], share: int, memory: int | None) -> None:
    """Do what comes through a pipe, until it is closed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
        limit_processors(share)
        with limited_memory(memory):
            pipe.send(())
            while True:
                pipe.send((function(pipe.recv()),))
    # A signal that comes while Python takes itself apart would print where.
    os._exit(0)


def _end_with_parent() -> None:
    """End this process when the one that started it has died: nobody waits for its results."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)


@contextlib.contextmanager
def limited_memory(size: int | None) -> Iterator[None]:
    """Let no more than so many bytes be allocated by this process inside; None: as many as it may outside.

    Raises:
        InputError: this system cannot do that.
    """
    if size is None:
        yield
        return
    if sys.platform != "linux":
        raise InputError("--memory: only Linux limits the memory of a process; leave it out.")
    import resource

    # OpenBLAS, which it loads, tries for ever where it finds no memory for itself.
    import scipy.special  # noqa: F401

    before, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (size if hard == resource.RLIM_INFINITY else min(size, hard), hard))
    try:
        with _failed_threads_told():
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (before, hard))


@contextlib.contextmanager
def _failed_threads_told() -> Iterator[None]:
    """Raise a MemoryError in the main thread where a thread has no memory to begin: Python waits for it for ever."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    main, unraisable, heard = threading.main_thread().ident, sys.unraisablehook, False

    def tell(failure: Any) -> None:
        nonlocal heard
        if main is None or not issubclass(failure.exc_type, MemoryError):
            unraisable(failure)
            return
        heard = False
        # One that comes just before the main thread begins to wait does not wake it.
        while not heard:
            signal.pthread_kill(main, signal.SIGUSR1)
            time.sleep(_AGAIN)

    def hear(_number: int, _frame: FrameType | None) -> None:
        nonlocal heard
        heard = True
        raise MemoryError

    handler = signal.signal(signal.SIGUSR1, hear)
    sys.unraisablehook = tell
    try:
        yield
    finally:
        heard = True
        sys.unraisablehook = unraisable
        signal.signal(signal.SIGUSR1, handler)


@contextlib.contextmanager
def _threads(count: int) -> Iterator[None]:
    """Let libraries of processes that are started inside start so many threads."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, str(count)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _signals_held() -> Iterator[None]:
    """Hold back Ctrl-C and SIGTERM: a process that is started inside gets neither while it imports.

    Ctrl-C goes to every process of a terminal, and it is for the first of them to end the others.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
