"""Work on many items at once: threads or processes, one per processor."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")


# Most processors that this process uses; None: all that it may.
_share: int | None = None


def processors() -> int:
    """Processors that this process may use."""
    present = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(present, _share or present)


def limit_processors(count: int) -> None:
    """Let this process use no more than so many processors, because others work beside it."""
    global _share
    _share = count
    torch.set_num_threads(count)


def in_threads(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Results of a function for each item, in their order, from one thread per processor.

    Work begins when the first result is asked for. Calls may be nested: each has threads of its own.
    """
    with single_threaded_torch(), ThreadPoolExecutor(processors()) as pool:
        yield from pool.map(function, items)


def in_groups(function: Callable[[Item], list[Result]], groups: Iterable[Sequence[Item]]) -> Iterator[Result]:
    """Results of a function that gives a list for each item, as `in_threads`, but one group of items after the other.

    A group is not drawn before the one before it is done, so that no more than one has to be in memory.
    """
    with single_threaded_torch(), ThreadPoolExecutor(processors()) as pool:
        for group in groups:
            if len(group) == 1:
                yield from function(group[0])
            else:
                yield from itertools.chain.from_iterable(pool.map(function, group))


def one_behind(function: Callable[[Item], object], items: Iterable[Item]) -> None:
    """Call a function for each item in a thread of its own, while the next item is made in this one."""
    with ThreadPoolExecutor(1) as pool:
        call: Future[object] | None = None
        for item in items:
            if call is not None:
                call.result()
            call = pool.submit(function, item)
        if call is not None:
            call.result()


def processes(most: int, prepare: Callable[..., None] | None = None, *arguments: Any) -> ProcessPoolExecutor:
    """A pool of fresh processes: one per processor, but no more than `most`.

    A forked process would inherit torch's threads without their being alive.

    Args:
        most: as many as there is work for.
        prepare: called in each process with `arguments` before anything else.
    """
    return ProcessPoolExecutor(min(processors(), most), multiprocessing.get_context("spawn"), prepare, arguments)


class _Threads(threading.local):
    """How often a thread has entered `single_threaded_torch` without leaving it."""

    depth = 0


_entered, _lock = _Threads(), threading.Lock()
# Threads inside, and the number of torch's threads before the first of them came.
_inside, _before = 0, 1


@contextmanager
def single_threaded_torch() -> Iterator[None]:
    """Let every torch call inside run on the calling thread.

    Tiles are too small to be worth splitting: threads that torch starts for one wait for each other more than they
    compute, and stall altogether beside another busy process. Estimates that run side by side leave torch as the first
    has found it.
    """
    global _inside, _before
    _entered.depth += 1
    if _entered.depth == 1:
        with _lock:
            if not _inside:
                _before = torch.get_num_threads()
            _inside += 1
            torch.set_num_threads(1)
    try:
        yield
    finally:
        _entered.depth -= 1
        if not _entered.depth:
            with _lock:
                _inside -= 1
                torch.set_num_threads(_before)
