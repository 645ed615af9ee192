"""Work on many items with one thread per processor."""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")


def walk(groups: Iterable[Sequence[Item]], work: Callable[[Item], list[Result]]) -> Iterator[Result]:
    """What `work` gives for each tile (or what else there is), in their order.

    One thread per processor works on a group.
    """
    with single_threaded_torch(), ThreadPoolExecutor(processors()) as pool:
        for group in groups:
            if len(group) == 1:
                yield from work(group[0])
            else:
                yield from itertools.chain.from_iterable(pool.map(work, group))


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


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
