"""The ends of tasks as Dask tells them, without Dask."""

from __future__ import annotations

from typing import Any


class KilledWorker(Exception):
    """What Dask calls it."""


class Future:
    """The end of a task, as Dask tells it."""

    def __init__(self, status: str, value: Any = None) -> None:
        self.status, self.value = status, value

    def result(self) -> Any:
        return self.value

    exception = result
