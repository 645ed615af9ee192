"""How long work tells what it is doing."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called with what is being done and, where it can be counted, how much of it."""

    def __call__(self, what: str, done: int | None = None, total: int | None = None) -> None: ...


def silent(what: str, done: int | None = None, total: int | None = None) -> None:
    """Tell nobody."""
