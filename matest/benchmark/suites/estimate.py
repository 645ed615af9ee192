"""Time of an estimate of 12 photographs of a megapixel, stage by stage, against the time to decode them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Group

import matest
from matest.benchmark.instruments.photographs import FIX, in_files
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.suites.limits import decode
from matest.benchmark.tables import by_case, largest, listed, page

IMAGES = 12
# Pixels on a side of the images: a megapixel.
SIZE = 1024
SIZE_QUICK = 384
# Estimates, of which the shortest counts.
ROUNDS = 3
ROUNDS_QUICK = 2
# Fit against decoding, at most.
LIMITS = {"oren-nayar": 1.0, "cook-torrance": 3.0}
STAGES = ("read", "geometry", "fit")


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of the models of `LIMITS`, each on photographs of its own material."""
    size, rounds = (SIZE_QUICK, ROUNDS_QUICK) if effort.quick else (SIZE, ROUNDS)
    for expression in LIMITS:
        progress(f"{expression}: taking the photographs")
        with in_files(expression, images=IMAGES, size=size) as folder:
            # Limits are those of a megapixel.
            limit = None if effort.quick else LIMITS[expression]
            yield from stages_of(expression, folder, rounds, progress, limit)


def stages_of(expression: str, folder: Path, rounds: int, progress: Progress, limit: float | None) -> Iterator[Record]:
    """Decode and estimate in turns, `rounds` times; of every stage the shortest time counts.

    The first estimate of a process, which also loads and prepares what later ones find ready, has a record of its own.
    """
    turns = []
    for number in range(rounds):
        progress(expression, number, rounds)
        decoded = decode(folder)
        estimate = matest.estimate(matest.load_capture(folder), expression, fix=FIX[expression])
        turns.append({**estimate.timing_s, "decode": decoded})
    shortest = {stage: min(turn[stage] for turn in turns) for stage in ("decode", *STAGES)}
    yield Record("estimate", expression, "photographs", IMAGES, "1", "higher")
    yield Record("estimate", expression, "samples", estimate.fit.samples, "1", "higher")
    for stage, seconds in shortest.items():
        yield Record("estimate", expression, stage, seconds, "s")
    yield Record("estimate", expression, "first fit", turns[0]["fit"], "s")
    decoded, fit = shortest["decode"], shortest["fit"]
    note = f"decoded in {decoded:.2f} s by OpenCV, fitted in {fit:.2f} s ({estimate.fit.samples:,} samples)"
    yield Record("estimate", expression, "fit / decode", fit / decoded, "1", limit=limit, note=note)


def table(records: Sequence[Record]) -> Group:
    """Stages of every estimate, and the fit against decoding."""
    stages = listed("seconds", ("decode", *STAGES, "first fit", "fit / decode"), by_case(records))
    about = (
        f"{largest(records, 'photographs')} photographs, 16-bit RGB PNG, {largest(records, 'samples'):,} samples. "
        "Decode: OpenCV alone; read: the same by matest, which keeps the object's pixels; geometry: normals, rays, "
        "directions; fit: everything else up to the answer. First fit: of the process."
    )
    return page(about, stages, records=records)


SUITE = Suite(measure, table)
