"""Jobs on many machines: any deployment of Dask, or one process for each processor of this machine."""

from __future__ import annotations

import contextlib
import logging
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
        # What is lost is told in one sentence; Dask would tell it in a hundred.
        for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        place: Any = address
        if address == LOCAL:
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
        yield client


def _close(place: Any) -> None:
    """Close a client or a cluster, or leave what does not end in time to the end of the process."""
    with contextlib.suppress(TimeoutError):
        place.close(timeout=_GRACE)
