"""What errors of the calibration do to estimates: as they are, with their size stated, and with them estimated too."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

import matest
from matest.benchmark.instruments import miscalibration as off
from matest.benchmark.instruments.miscalibration import SIZE, Setting, photograph
from matest.benchmark.instruments.photographs import vase
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, page, ruled
from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.inference.quantities import ParameterEstimate
from matest.scene import Surface
from matest.workers import processes, single_threaded_torch

CAPTURES = 100
CAPTURES_QUICK = 2
# Photographs of each capture, and the farthest that a light stands off the camera, degrees.
LIGHTS = 8
_OBLIQUE = 60.0
# How a capture is estimated.
COLUMNS = ("today", "declared", "refined", "all")
# Least coverage of 95 % intervals where the errors' size is stated; and where each pixel has its own, which also make
# every lobe wider, by their square.
_COVERAGE, _COVERAGE_OF_NOISE = 0.92, 0.88
# Largest ratio of the mean standard error to the rms error there.
_WIDEST = 1.5
# Least factor by which estimating the errors makes the rms error smaller.
_GAIN, _GAIN_OF_MANY = 10.0, 5.0
_DEGREE = math.radians(1)
# A turn of one degree about a random axis, as the standard deviation about each of three.
_TURN = _DEGREE / math.sqrt(3)
# A shift of one pixel in a random direction, likewise of two.
_SHIFT = 1 / math.sqrt(2)
# A number of a pose that is right: none is stated to be exact.
_RIGHT = 1e-3
# Smooth variations within ± 20 % are of this rms, relative.
_SMOOTH = 0.1


class Thing(NamedTuple):
    """An object of one material, and what is estimated of it.

    Attributes:
        surface: as it is stated.
        build: makes its material.
        body: parameter that is its albedo.
        parameter: that the figures are of.
        fixed: parameters that are not estimated.
    """

    surface: Callable[[], Surface]
    build: Callable[[], Brdf]
    body: str
    parameter: str
    fixed: Mapping[str, float]


def _sphere() -> Brdf:
    values: dict[str, Any] = {"albedo": [0.7, 0.5, 0.3], "sigma": 0.4}
    return OrenNayar(**values)


def _vase() -> Brdf:
    values: dict[str, Any] = {"diffuse": [0.4, 0.2, 0.1], "specular": [0.8, 0.8, 0.8], "slope": 0.2, "f0": 0.04}
    return CookTorrance(**values)


OBJECTS = {
    "sphere": Thing(off.ball, _sphere, "albedo", "sigma", {}),
    "vase": Thing(lambda: vase(SIZE), _vase, "diffuse", "slope", {"f0": 0.04}),
}


class Row(NamedTuple):
    """One thing that is wrong.

    Attributes:
        error: makes the true setting of the stated one.
        size: its standard deviation, by family.
        gain: least factor by which estimating it must make the error smaller; None: any.
        coverage: least coverage where its size is stated.
        objects: that can have it.
        refinable: whether it can be estimated as well.
    """

    error: off.Error
    size: Mapping[str, float | tuple[float, float]]
    gain: float | None = None
    coverage: float = _COVERAGE
    objects: tuple[str, ...] = tuple(OBJECTS)
    refinable: bool = True


ROWS: dict[str, Row] = {
    "nothing wrong": Row(off.together(), {}),
    "directions 1° each": Row(off.directions(_DEGREE), {"direction": _DEGREE}, _GAIN),
    "common rotation 1°": Row(off.rotation(_DEGREE), {"rotation": _TURN}, _GAIN),
    "intensities 3 %": Row(off.intensities(0.03), {"intensity": 0.03}, _GAIN),
    "ambient 1 %": Row(off.constant(ambient=0.01), {"ambient": 0.01}, _GAIN),
    "ambient 3 %": Row(off.constant(ambient=0.03), {"ambient": 0.03}, _GAIN),
    "black level 2 %": Row(off.constant(black=0.02), {"black": 0.02}, _GAIN),
    "vignetting 5 %": Row(off.constant(vignetting=0.05), {"vignetting": 0.05}, _GAIN),
    "vignetting 10 %": Row(off.constant(vignetting=0.1), {"vignetting": 0.1}, _GAIN),
    "radius 1 px": Row(off.radius(1.0), {"radius": 1.0}, _GAIN, objects=("sphere",)),
    "centre 1 px": Row(off.centre(1.0), {"pose": (_SHIFT, _RIGHT)}, _GAIN, objects=("sphere",)),
    "mesh turned 1°": Row(off.turned(_DEGREE), {"pose": (_RIGHT, _TURN)}, objects=("vase",)),
    "sRGB read as 2.2": Row(off.constant(transfer="srgb", read_as=2.2), {"curve": 1.0}),
    "normals 1° smooth": Row(off.smooth_normals(_DEGREE), {"normals": _DEGREE}, _GAIN_OF_MANY),
    "normals 2° by pixel": Row(
        off.noisy_normals(2 * _DEGREE), {"normal_noise": 2 * _DEGREE}, coverage=_COVERAGE_OF_NOISE, refinable=False
    ),
    "albedo ±20 % smooth": Row(off.smooth_albedo(_SMOOTH), {"albedo": _SMOOTH}, _GAIN),
    "albedo ±20 % halves": Row(off.two_regions(0.2), {"albedo": 0.2}),
    "blur 0.7 px": Row(off.constant(blur=0.7), {"blur": 0.7}, _GAIN),
    "blur 1.5 px": Row(off.constant(blur=1.5), {"blur": 1.5}, _GAIN),
    # The mean over three rays in a row is as wide as a Gaussian of this standard deviation.
    "pixels that average": Row(off.averaged(3), {"blur": math.sqrt((1 - 1 / 9) / 12)}),
    "four at once": Row(
        off.together(
            off.directions(_DEGREE / 2), off.intensities(0.01), off.smooth_albedo(_SMOOTH / 4),
            off.constant(ambient=0.01),
        ),
        {"direction": _DEGREE / 2, "intensity": 0.01, "albedo": _SMOOTH / 4, "ambient": 0.01},
        _GAIN_OF_MANY,
    ),
}  # fmt: skip

# Rows in which every kind of error is estimated in short runs too.
_ALL = ("nothing wrong", "four at once")


@dataclass(frozen=True)
class Outcome:
    """What one estimate says of the parameter.

    Attributes:
        error: of its value, relative; NaN where it is not determined.
        std: its standard error, relative; NaN where there is none, as at a bound.
        covered: whether its 95 % interval holds the truth; an interval that is not there does not.
    """

    error: float
    std: float
    covered: bool


def asked(row: Row, column: str) -> dict[str, Any]:
    """The arguments of an estimate, by column."""
    ways: dict[str, dict[str, Any]] = {
        "today": {},
        "declared": {"uncertainty": row.size},
        "refined": {"refine": tuple(row.size)},
        "all": {"refine": "all"},
    }
    return ways[column]


def columns_of(name: str, effort: Effort) -> tuple[str, ...]:
    """How captures of a row are estimated.

    Where nothing is wrong nothing can be stated of it. Every kind of error is estimated in all rows only where the
    suite is measured alone, since that takes a dozen times as long as the rest.
    """
    row = ROWS[name]
    possible = {
        "today": True,
        "declared": bool(row.size),
        "refined": bool(row.size) and row.refinable,
        "all": name in _ALL or not (effort.quick or effort.shared),
    }
    return tuple(column for column in COLUMNS if possible[column])


def trial(name: str, kind: str, columns: Sequence[str], seed: int) -> dict[str, Outcome]:
    """Photograph an object with one thing wrong, and estimate its material in some ways."""
    row, thing = ROWS[name], OBJECTS[kind]
    generator = np.random.default_rng([crc32(f"{name}, {kind}".encode()), seed])
    material = thing.build()
    truth = float(material.parameters[thing.parameter])
    stated = Setting(thing.surface(), light_directions(generator), np.ones(LIGHTS))
    outcomes = {}
    with single_threaded_torch():
        capture = photograph(stated, row.error(stated, generator), material, thing.body, generator)
        for column in columns:
            estimate = matest.estimate(capture, material.expression, fix=thing.fixed, **asked(row, column))
            outcomes[column] = _outcome(estimate.parameters[thing.parameter], truth)
    return outcomes


def _outcome(found: ParameterEstimate, truth: float) -> Outcome:
    value, std = (number if isinstance(number, float) else math.nan for number in (found.value, found.std))
    low, high = found.interval95 or (math.nan, math.nan)
    return Outcome(value / truth - 1, std / truth, low <= truth <= high)


def light_directions(generator: np.random.Generator) -> np.ndarray:
    """Unit vectors [K, 3], evenly drawn within `_OBLIQUE` of the camera."""
    z = 1 - generator.random(LIGHTS) * (1 - math.cos(math.radians(_OBLIQUE)))
    turn, across = 2 * math.pi * generator.random(LIGHTS), np.sqrt(1 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every row and object."""
    captures = CAPTURES_QUICK if effort.quick else CAPTURES
    cases = [(name, kind) for kind in OBJECTS for name, row in ROWS.items() if kind in row.objects]
    with processes(captures) as pool:
        for name, kind in cases:
            outcomes: list[dict[str, Outcome]] = []
            end = time.perf_counter() + effort.seconds / len(cases)
            columns = columns_of(name, effort)
            some = pool.map(trial, [name] * captures, [kind] * captures, [columns] * captures, range(captures))
            for result in some:
                outcomes.append(result)
                progress(f"{kind}: {name}", len(outcomes), captures)
                if time.perf_counter() > end:
                    break
            yield from _records(name, kind, columns, outcomes)


def _records(
    name: str, kind: str, columns: Sequence[str], outcomes: Sequence[Mapping[str, Outcome]]
) -> Iterator[Record]:
    """Coverage, rms error, its ratio to the mean standard error, and the gain, of each column."""
    row, case = ROWS[name], f"{kind}: {name}"
    yield Record("calibration", case, "captures", len(outcomes), "1", "higher")
    errors: dict[str, float] = {}
    for column in columns:
        some = [outcome[column] for outcome in outcomes]
        determined = [one for one in some if not math.isnan(one.error)]
        barred = [one for one in determined if not math.isnan(one.std)]
        note = "" if len(barred) == len(some) else f"without error bar: {len(some) - len(barred)}"
        declared = column == "declared"
        coverage = sum(one.covered for one in some) / len(some)
        limit = row.coverage if declared else None
        yield Record("calibration", case, f"coverage, {column}", coverage, "1", "higher", limit, note)
        if not barred:
            yield Record("calibration", case, f"error, {column}", None, "1", note=note)
            continue
        errors[column] = math.sqrt(np.mean([one.error**2 for one in determined]))
        yield Record("calibration", case, f"error, {column}", errors[column], "1", note=note)
        ratio = float(np.mean([one.std for one in barred])) / errors[column]
        yield Record("calibration", case, f"std / error, {column}", ratio, "1", limit=_WIDEST if declared else None)
        if column in ("refined", "all") and "today" in errors:
            gain = errors["today"] / errors[column]
            yield Record("calibration", case, f"gain, {column}", gain, "1", "higher", row.gain)


def table(records: Sequence[Record]) -> Group:
    """One table an object: a row for each thing that is wrong, and four columns."""
    cases = by_case(records)
    about = (
        f"{LIGHTS} photographs of {SIZE}×{SIZE} pixels, lights within {_OBLIQUE:g}° of the camera, one thing off each. "
        "In each column: coverage of 95 % intervals (%), rms error (%) and the mean standard error over it, of sigma "
        "(sphere, Oren-Nayar) or slope (vase, Cook-Torrance). Red: a limit is missed."
    )
    legend = (
        "today: nothing is said of it; declared: its size is stated; refined: it is estimated as well; all: every kind "
        f"of error is. –: without error bar. Limits: declared, coverage {_COVERAGE:g} ({_COVERAGE_OF_NOISE:g} for "
        f"normals by pixel) and ratio {_WIDEST:g}; refined and all, an error {_GAIN:g} times smaller than today "
        f"({_GAIN_OF_MANY:g} for smooth normals and four at once; any for the rest)."
    )
    parts: list[RenderableType] = []
    for kind in OBJECTS:
        rows = ruled(kind, *COLUMNS)
        for case, by_metric in cases.items():
            if case.startswith(f"{kind}: "):
                cells = [_cell(by_metric, column) for column in COLUMNS]
                rows.add_row(case.removeprefix(f"{kind}: "), *cells)
        parts += [rows, ""]
    return page(about, *parts, Text(legend), records=records)


def _cell(by_metric: Mapping[str, Record], column: str) -> Text:
    """The three figures of a column, red where any misses its limit; empty where there is none."""
    metrics = [f"{what}, {column}" for what in ("coverage", "error", "std / error", "gain")]
    shown = [by_metric[metric] for metric in metrics if metric in by_metric]
    values = [record.value for record in shown[:3] if record.value is not None]
    if len(values) < 3:
        return Text("–" if shown else "")
    coverage, error, ratio = values
    style = "red" if any(record.misses for record in shown) else ""
    digits = 1 if error >= 0.01 else 2
    return Text(f"{100 * coverage:.0f} {100 * error:.{digits}f} {ratio:.2f}", style=style)


SUITE = Suite(measure, table, share=30)
