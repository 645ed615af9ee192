"""Jobs on many machines: any deployment of Dask, or one process for each processor of this machine."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from matest.errors import InputError, WorkError
from matest.pool import Lost
from matest.workers import limit_processors, processors

Item = TypeVar("Item")
Result = TypeVar("Result")

# The address that asks for workers on this machine.
LOCAL = "local"
# Seconds in which a scheduler has to answer.
_ANSWER = 10
# Seconds that workers of this machine have to end.
_GRACE = 0.5
# Packages that print what is lost at length, where one sentence tells it.
_TALKERS = ("distributed", "tornado", "asyncio")


class SchedulerLostError(WorkError):
    """The scheduler does not answer any more: nothing can be asked of its workers."""


def scheduler_lost(address: str) -> SchedulerLostError:
    return SchedulerLostError(f"--scheduler {address}: the scheduler was lost.")


def in_cluster(
    function: Callable[[Item], Result], items: Iterable[Item], address: str
) -> Iterator[tuple[Item, Result | Lost]]:
    """Every item with the result of a function, as they are done, from the workers of a scheduler.

    The task of a worker that is lost goes to another one.

    Args:
        function: that can be pickled, as the items and results can.
        items: any number.
        address: of the scheduler, as "tcp://host:8786", or "local".

    Raises:
        InputError: Dask is not installed, or no scheduler answers there.
        WorkError: the scheduler is lost.
    """
    with client_of(address) as client:
        task = _Alone(function)
        items_of = {client.submit(task, item, pure=False): item for item in items}
        for future in _completed(client, items_of):
            # What is no longer named here is forgotten by the scheduler too.
            yield items_of.pop(future), _result(future, address)


def ends(client: Any, futures: Iterable[Any], address: str) -> Iterator[tuple[Any, Any]]:
    """Futures of a client with the results of their tasks, as they are done.

    It is `Lost` where every worker that had the task died, and None where what the task needs went with a worker.

    Raises:
        SchedulerLostError: the scheduler is lost.
        WorkError: workers cannot do it.
    """
    for future in _completed(client, futures):
        went = future.status not in ("finished", "error") and is_reachable(client)
        yield future, None if went else _result(future, address)


def is_reachable(client: Any) -> bool:
    """Whether the scheduler of a client answers."""
    try:
        client.sync(client.scheduler.identity, callback_timeout=_ANSWER)
    except (OSError, TimeoutError, RuntimeError):
        return False
    return True


def _completed(client: Any, futures: Iterable[Any]) -> Iterator[Any]:
    from dask.distributed import as_completed

    return iter(as_completed([*futures], loop=client.loop, raise_errors=False))


def _result(future: Any, address: str) -> Any:
    """The result of a task, or that it is lost.

    Raises:
        SchedulerLostError: the scheduler is lost.
        WorkError: the function cannot be called on its workers.
    """
    if future.status == "finished":
        return future.result()
    if future.status != "error":
        raise scheduler_lost(address)
    error = future.exception()
    if type(error).__name__ == "KilledWorker":
        return Lost("the worker that had it was lost")
    raise WorkError(f"--scheduler {address}: its workers cannot do it ({type(error).__name__}: {error}).")


class _Alone:
    """A function that uses one thread: a worker has as many tasks at once as threads."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function = function

    def __call__(self, item: Any) -> Any:
        limit_processors(1)
        return self.function(item)


@contextlib.contextmanager
def client_of(address: str) -> Iterator[Any]:
    """A client of a scheduler; where it is local, its workers end with it.

    Raises:
        InputError: Dask is not installed, or no scheduler answers there.
    """
    try:
        from dask import config
        from dask.distributed import Client, LocalCluster
    except ImportError:
        raise InputError('--scheduler needs Dask: pip install "matest-brdf[cluster]".') from None
    with contextlib.ExitStack() as stack:
        stack.enter_context(config.set({"distributed.comm.timeouts.connect": _ANSWER}))
        for name in [name for name in logging.root.manager.loggerDict if name.startswith(_TALKERS)]:
            # Above every level: of what ends early also the loop of events complains.
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        place: Any = address
        if address == LOCAL:
            stack.enter_context(_nothing_running_after())
            place = LocalCluster(
                n_workers=processors(), threads_per_worker=1, dashboard_address=None, memory_limit=0,
                silence_logs=logging.CRITICAL,
            )  # fmt: skip
            stack.callback(_close, place)
        try:
            client = Client(place, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError):
            raise InputError(f"--scheduler {address}: no Dask scheduler answers there; check the address.") from None
        stack.callback(_close, client)
        if address == LOCAL:
            stack.enter_context(_abandoned_early(place))
        yield client


@contextlib.contextmanager
def _nothing_running_after() -> Iterator[None]:
    """Processes that are started inside end with the block, by force if need be."""
    others = multiprocessing.active_children()
    try:
        yield
    finally:
        for process in multiprocessing.active_children():
            if process not in others:
                process.kill()
                process.join(_GRACE)


@contextlib.contextmanager
def _abandoned_early(cluster: Any) -> Iterator[None]:
    """Where the block ends early, the workers of a cluster end at once: nobody waits for what they are at."""
    try:
        yield
    except BaseException:
        for nanny in cluster.workers.values():
            # Otherwise it would start another one.
            nanny.close_gracefully()
            if pid := nanny.pid:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        raise


def _close(place: Any) -> None:
    """Close a client or a cluster, or leave what does not end in time to the end of the process."""
    with contextlib.suppress(TimeoutError):
        place.close(timeout=_GRACE)
