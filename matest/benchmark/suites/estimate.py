"""Time of an estimate of 12 photographs of a megapixel, stage by stage, against the time to decode them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Group

import matest
from matest.benchmark.instruments.photographs import FIX, take
from matest.benchmark.record import Progress, Record
from matest.benchmark.suite import Effort, Suite
from matest.benchmark.suites.limits import decode
from matest.benchmark.tables import by_case, largest, listed, page

IMAGES = 12
SIZE, SIZE_QUICK = 1024, 384
ROUNDS, ROUNDS_QUICK = 3, 2
# Fit against decoding, at most.
LIMITS = {"oren-nayar": 1.0, "cook-torrance": 3.0}
STAGES = ("read", "geometry", "fit")


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of the models of `LIMITS`, each on photographs of its own material."""
    size, rounds = (SIZE_QUICK, ROUNDS_QUICK) if effort.quick else (SIZE, ROUNDS)
    for expression in LIMITS:
        progress(f"{expression}: taking the photographs")
        with tempfile.TemporaryDirectory() as folder:
            photographs = take(Path(folder), expression, images=IMAGES, size=size)
            # Limits are those of a megapixel.
            limit = None if effort.quick else LIMITS[expression]
            yield from stages_of(expression, photographs, rounds, progress, limit)


def stages_of(expression: str, folder: Path, rounds: int, progress: Progress, limit: float | None) -> Iterator[Record]:
    """Decode and estimate in turns, `rounds` times; of every stage the shortest time counts.

    The first estimate of a process, which also loads and prepares what later ones find ready, has a record of its own.
    """
    decoded: list[float] = []
    stages: dict[str, list[float]] = {stage: [] for stage in STAGES}
    files = sorted(folder.glob("[0-9]*.png"))
    for number in range(rounds):
        progress(expression, number, rounds)
        decoded.append(decode(files))
        estimate = matest.estimate(matest.load_capture(folder), expression, fix=FIX[expression])
        for stage in STAGES:
            stages[stage].append(estimate.timing_s[stage])
    shortest = min(decoded)
    yield Record("estimate", expression, "photographs", len(files), "1", "higher")
    yield Record("estimate", expression, "samples", estimate.fit.samples, "1", "higher")
    yield Record("estimate", expression, "decode", shortest, "s")
    for stage in STAGES:
        yield Record("estimate", expression, stage, min(stages[stage]), "s")
    yield Record("estimate", expression, "first fit", stages["fit"][0], "s")
    fit = min(stages["fit"])
    note = f"decoded in {shortest:.2f} s by OpenCV, fitted in {fit:.2f} s ({estimate.fit.samples:,} samples)"
    yield Record("estimate", expression, "fit / decode", fit / shortest, "1", limit=limit, note=note)


def table(found: Sequence[Record]) -> Group:
    """Stages of every estimate, and the fit against decoding."""
    stages = listed("seconds", ("decode", *STAGES, "first fit", "fit / decode"), by_case(found))
    about = (
        f"{largest(found, 'photographs')} photographs, 16-bit RGB PNG, {largest(found, 'samples'):,} samples. Decode: "
        "OpenCV alone; read: the same by matest, which keeps the object's pixels; geometry: normals, rays, directions; "
        "fit: everything else up to the answer. First fit: of the process."
    )
    return page(about, stages, records=found)


SUITE = Suite(measure, table)
