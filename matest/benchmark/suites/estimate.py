"""Time of an estimate of 12 photographs of a megapixel, stage by stage, against the time to decode them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark.instruments.photographs import take
from matest.benchmark.record import Progress, Record
from matest.benchmark.suites.limits import decode
from matest.benchmark.tables import by_case, case_name, figure, notes, ruled

IMAGES = 12
SIZE, SIZE_QUICK = 1024, 384
ROUNDS, ROUNDS_QUICK = 3, 2
# Fit against decoding, at most.
LIMITS = {"oren-nayar": 1.0, "cook-torrance": 3.0}
STAGES = ("read", "geometry", "fit")


def run(quick: bool, progress: Progress) -> Iterator[Record]:
    """Records of the models of `LIMITS`, each on photographs of its own material."""
    size, rounds = (SIZE_QUICK, ROUNDS_QUICK) if quick else (SIZE, ROUNDS)
    for expression in LIMITS:
        progress(f"{expression}: taking the photographs")
        with tempfile.TemporaryDirectory() as folder:
            photographs = take(Path(folder), expression, images=IMAGES, size=size)
            # Limits are those of a megapixel.
            limit = None if quick else LIMITS[expression]
            yield from measure(expression, photographs, rounds, progress, limit)


def measure(
    expression: str, folder: Path, rounds: int, progress: Progress, limit: float | None = None
) -> Iterator[Record]:
    """Decode and estimate in turns, `rounds` times; of every stage the shortest time counts.

    The first estimate of a process, which also loads and prepares what later ones find ready, has a record of its own.
    """
    decoded: list[float] = []
    stages: dict[str, list[float]] = {stage: [] for stage in STAGES}
    files = sorted(folder.glob("[0-9]*.png"))
    for number in range(rounds):
        progress(expression, number, rounds)
        decoded.append(decode(files))
        # f0 is held as the targets have it.
        held = {"f0": 0.04} if expression == "cook-torrance" else {}
        found = matest.estimate(matest.load_capture(folder), expression, fix=held)
        for stage in STAGES:
            stages[stage].append(found.timing_s[stage])
    shortest = min(decoded)
    yield Record("estimate", expression, "photographs", len(files), "1", "higher")
    yield Record("estimate", expression, "samples", found.fit.samples, "1", "higher")
    yield Record("estimate", expression, "decode", shortest, "s")
    for stage in STAGES:
        yield Record("estimate", expression, stage, min(stages[stage]), "s")
    yield Record("estimate", expression, "first fit", stages["fit"][0], "s")
    fit = min(stages["fit"])
    note = f"decoded in {shortest:.2f} s by OpenCV, fitted in {fit:.2f} s ({found.fit.samples:,} samples)"
    yield Record("estimate", expression, "fit / decode", fit / shortest, "1", limit=limit, note=note)


def estimate_table(found: list[Record]) -> Group:
    """Stages of every estimate, and the fit against decoding."""
    columns = ("decode", *STAGES, "first fit", "fit / decode")
    table = ruled("seconds", *columns)
    cases = by_case(found)
    for case, metrics in cases.items():
        table.add_row(case_name(case), *(figure(metrics[column]) for column in columns))
    photographs, samples = (
        max(int(metrics[name].value or 0) for metrics in cases.values()) for name in ("photographs", "samples")
    )
    about = (
        f"{photographs} photographs, 16-bit RGB PNG, {samples:,} samples. Decode: OpenCV alone; read: the same by "
        "matest, which keeps the object's pixels; geometry: normals, rays, directions; fit: everything else up to the "
        "answer. First fit: of the process."
    )
    return Group(Text(about), "", table, *notes(found))
