"""What the machine can do at best, measured in the same run as the figures that are compared with it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cv2
import torch
from rich.console import Group

from matest.benchmark.instruments.passes import TILE, product, seconds, timed
from matest.benchmark.instruments.photographs import in_files
from matest.benchmark.suite import QUICK, Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, figure, page, ruled
from matest.workers import in_threads, processors

# Numbers in an array that no cache holds: 128 MB.
LARGE = 2**25
# Photographs that are decoded, pixels on a side of each, and how often: the shortest time counts.
IMAGES = 4
SIZE = 384
ROUNDS = 5


class Limits(NamedTuple):
    """Limits of the machine, in seconds.

    Attributes:
        copy: one byte of a large array.
        decode: one pixel of a 16-bit RGB PNG, one thread a processor.
        tiled: one element-wise product of float32 numbers, per number, in tiles that the cache holds.
        whole: the same in one call on a large array.
    """

    copy: float
    decode: float
    tiled: float
    whole: float


@cache
def machine() -> Limits:
    """The limits, measured once a process."""
    source, numbers = torch.ones(LARGE), LARGE // 8
    target = torch.empty_like(source)
    copied, tiled, whole = seconds(lambda: target.copy_(source), product(numbers, TILE), product(numbers, numbers))
    with in_files("oren-nayar", images=IMAGES, size=SIZE) as folder:
        decoded = min(decode(folder) for _ in range(ROUNDS))
    return Limits(copied / (4 * LARGE), decoded / (IMAGES * SIZE**2), tiled / numbers, whole / numbers)


def decode(folder: Path) -> float:
    """Seconds that OpenCV needs to decode the images of a capture, one thread per processor."""
    files = sorted(folder.glob("[0-9]*.png"))
    images = in_threads(lambda file: cv2.imread(str(file), cv2.IMREAD_UNCHANGED), files)
    return timed(lambda: deque(images, maxlen=0))[1]


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of the limits, and of what run they belong to."""
    progress("copy, decoding, one element-wise pass")
    limits = machine()
    yield Record("limits", "run", QUICK, int(effort.quick), "1")
    yield Record("limits", "machine", "processors", processors(), "1", "higher")
    # A copy reads and writes.
    yield Record("limits", "machine", "memory bandwidth", 2e-9 / limits.copy, "GB/s", "higher")
    yield Record("limits", "machine", "decoding", 1e9 * limits.decode, "ns")
    yield Record("limits", "machine", "pass in tiles", 1e9 * limits.tiled, "ns")
    yield Record("limits", "machine", "pass in one call", 1e9 * limits.whole, "ns")


def table(records: Sequence[Record]) -> Group:
    """The limits in one row."""
    heads = ("memory\nGB/s", "decoding\nns a pixel", "pass in tiles\nns a number", "in one call\nns a number")
    limits = ruled("processors", *heads)
    limits.add_row(*map(figure, by_case(records)["machine"].values()))
    about = (
        "What this machine can do at best, measured in this run: copying a large array; decoding 16-bit RGB PNG with "
        "OpenCV; one element-wise product of two tensors."
    )
    return page(about, limits, records=records)


SUITE = Suite(measure, table)
