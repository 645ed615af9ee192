"""Tiles: groups of functions that give a batch each, computed when a worker asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from matest.samples.batch import Batch

# A group is worked on at once.
Tiles = Iterable[Sequence[Callable[[], Batch]]]


def in_memory(batches: Iterable[Batch]) -> list[list[Callable[[], Batch]]]:
    """Batches that are already there, as tiles."""
    return [[partial(_itself, batch) for batch in batches]]


def _itself(batch: Batch) -> Batch:
    return batch
