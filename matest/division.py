"""One capture over many machines: workers of a cluster do parts of a pass over it, from files that they read."""

from __future__ import annotations

import contextlib
import io
import pickle
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

from matest.cluster import client_of, ends, is_reachable, scheduler_lost
from matest.errors import WorkError
from matest.pool import Lost
from matest.workers import in_groups, limit_processors

Item = TypeVar("Item")
Made = TypeVar("Made", covariant=True)
Result = TypeVar("Result")

# Blocks of a pass for each worker: so many that one that is late does not keep the others waiting.
_BLOCKS_EACH = 4
# Seconds between two questions whether there is a worker.
_WAIT = 0.1
# Times that a pass is begun because workers took what it needs along, before it is given up.
_ATTEMPTS = 4


@runtime_checkable
class Source(Protocol):
    """Something large that each process has once, and that functions of a pass refer to."""

    @property
    def divisible(self) -> bool:
        """Whether another process can have it without being sent all of it."""

    def parts(self) -> Mapping[Any, object]:
        """What functions of a pass may refer to, by name; itself too."""

    def part(self, name: Any) -> object:
        """The part of that name."""

    def release(self) -> None:
        """Free memory that is not needed between two blocks of a pass."""


@runtime_checkable
class Divisible(Protocol[Made]):
    """Items in groups, which another process can make that has their source."""

    @property
    def source(self) -> Source: ...

    def __iter__(self) -> Iterator[Sequence[Made]]: ...


def over_groups(function: Callable[[Item], list[Result]], groups: Iterable[Sequence[Item]]) -> Iterator[Result]:
    """As `workers.in_groups`; inside `divided`, by the workers of the cluster where another process can make the items.

    Results come in the order of the items in either case.
    """
    if _division is not None and isinstance(groups, Divisible) and groups.source.divisible:
        return _division.over(function, groups)
    return in_groups(function, groups)


@contextlib.contextmanager
def divided(address: str) -> Iterator[Division]:
    """Let workers of a scheduler do the passes that are made inside, by whatever thread.

    Raises:
        InputError: Dask is not installed, or no scheduler answers there.
    """
    global _division
    with client_of(address) as client:
        _division = Division(client, address)
        try:
            yield _division
        finally:
            _division = None


class Division:
    """The passes of one estimate over the workers of a cluster."""

    def __init__(self, client: Any, address: str) -> None:
        self._client = client
        self._address = address
        self._present: tuple[Source, Any] | None = None

    def over(self, function: Callable[[Item], list[Result]], groups: Divisible[Item]) -> Iterator[Result]:
        """See `over_groups`.

        Raises:
            SchedulerLostError: the scheduler is lost.
            WorkError: workers are lost again and again.
        """
        items = [item for group in groups for item in group]
        names = {id(part): name for name, part in groups.source.parts().items()}
        work = _pickled(function, names)
        blocks = [_pickled(some, names) for some in _cut(items, self._threads() * _BLOCKS_EACH)]
        results: dict[int, list[Result]] = {}
        for _ in range(_ATTEMPTS):
            if len(results) == len(blocks):
                break
            self._attempt(groups.source, work, blocks, results)
        if len(results) < len(blocks):
            raise self._given_up()
        for number in range(len(blocks)):
            yield from results.pop(number)

    def _attempt(self, source: Source, work: bytes, blocks: Sequence[bytes], results: dict[int, list]) -> None:
        """Add the results of blocks that have none yet, as far as workers give them."""
        numbers = {}
        try:
            place, workers = self._placed(source), self._workers()
            for number in range(len(blocks)):
                if number not in results:
                    # A worker has the same images in every pass.
                    worker = workers[number * len(workers) // len(blocks)]
                    options = {"pure": False, "workers": [worker], "allow_other_workers": True}
                    numbers[self._client.submit(_block, place, work, blocks[number], **options)] = number
        except OSError:
            # A worker went meanwhile, or the scheduler.
            if not is_reachable(self._client):
                raise scheduler_lost(self._address) from None
        for future, end in ends(self._client, numbers, self._address):
            if isinstance(end, Lost):
                raise self._given_up()
            if isinstance(end, _Raised):
                raise end.error
            if end is not None:
                results[numbers[future]] = end
        if len(results) < len(blocks):
            self._present = None

    def _given_up(self) -> WorkError:
        return WorkError(
            f"--scheduler {self._address}: workers that had a part of the capture were lost, one after another; "
            "often memory does not suffice: give them more, or fewer threads."
        )

    def _threads(self) -> int:
        """Of all workers; waits for the first.

        Raises:
            SchedulerLostError: the scheduler is lost.
        """
        try:
            while not (workers := self._workers()):
                time.sleep(_WAIT)
        except OSError:
            raise scheduler_lost(self._address) from None
        return len(workers)

    def _workers(self) -> list[str]:
        """Addresses of the workers, one for each of their threads, in the same order every time."""
        return [address for address, count in sorted(self._client.nthreads().items()) for _ in range(count)]

    def _placed(self, source: Source) -> Any:
        """The source as workers have it; one at a time."""
        if self._present is None or self._present[0] is not source:
            self._present = None
            self._present = source, self._client.scatter(source, hash=False, broadcast=True)
        return self._present[1]


class _Raised(NamedTuple):
    """What a block ended with in place of results."""

    error: Exception


# Who does passes now; None: this process.
_division: Division | None = None


def _block(source: Source, work: bytes, block: bytes) -> list[Any] | _Raised:
    """The results of the items of a block, in their order, by a worker that has the source."""

    def results() -> list[Any]:
        function, items = _unpickled(work, source), _unpickled(block, source)
        return [result for item in items for result in function(item)]

    # A worker has as many blocks at once as threads.
    limit_processors(1)
    try:
        return results()
    except Exception as error:
        return _Raised(error)
    finally:
        source.release()


def _cut(items: Sequence[Item], count: int) -> list[Sequence[Item]]:
    """Nearly equal runs of items, `count` of them or fewer."""
    count = min(count, len(items))
    return [items[k * len(items) // count : (k + 1) * len(items) // count] for k in range(count)]


def _pickled(content: Any, names: Mapping[int, Hashable]) -> bytes:
    """Content as bytes, functions of functions too, with the names of parts of a source in their place."""
    import cloudpickle

    class Pickler(cloudpickle.Pickler):
        def persistent_id(self, thing: object) -> Hashable | None:
            return names.get(id(thing))

    file = io.BytesIO()
    Pickler(file).dump(content)
    return file.getvalue()


def _unpickled(content: bytes, source: Source) -> Any:
    """The content of bytes, with the parts of a source where their names stand."""

    class Unpickler(pickle.Unpickler):
        def persistent_load(self, name: Any) -> object:
            return source.part(name)

    return Unpickler(io.BytesIO(content)).load()
