"""Whether an estimate names what is wrong with a capture, and accuses none that is right."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark.instruments import miscalibration as off
from matest.benchmark.instruments.miscalibration import SIZE, Setting, photograph
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.suites.calibration import LIGHTS, OBJECTS, light_directions
from matest.benchmark.tables import by_case, listed, page
from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.workers import processes, single_threaded_torch

CAPTURES = 100
CAPTURES_QUICK = 2
# Least share of captures of which a cause that is there is named first; of which both of two are; most of which one is
# named where there is none.
_NAMED, _BOTH, _ACCUSED = 0.75, 0.7, 0.05
_DEGREE = math.radians(1)
_BODY = [0.4, 0.2, 0.1]


def _model(kind: Callable[..., Brdf], **values: Any) -> Brdf:
    """A model from numbers, which its constructor turns into tensors."""
    return kind(**values)


def _two_lobes() -> Brdf:
    return _model(CookTorrance, diffuse=_BODY, specular=0.8, f0=0.04, lobes="2", slope=0.08, slope_2=0.35, weight_2=0.5)


def _long_tailed() -> Brdf:
    return _model(CookTorrance, diffuse=_BODY, specular=0.8, f0=0.04, distribution="ggx", slope=0.15)


def _rough() -> Brdf:
    return _model(OrenNayar, albedo=[0.7, 0.5, 0.3], sigma=0.5)


class Wrong(NamedTuple):
    """What is wrong with a capture, or with the model that is named.

    Attributes:
        error: makes the true setting of the stated one.
        causes: by any of the names in each the result may call one thing that is wrong.
        objects: that can have it.
        material: of the object; None: the usual one of the suite `calibration`.
        expression: of the model that is named; empty: that of the material.
    """

    error: off.Error
    causes: tuple[frozenset[str], ...]
    objects: tuple[str, ...] = tuple(OBJECTS)
    material: Callable[[], Brdf] | None = None
    expression: str = ""


def _one(*names: str) -> tuple[frozenset[str], ...]:
    return (frozenset(names),)


_LIGHT, _STRENGTH, _SKY, _ALBEDO = "direction", "intensity", "ambient", ("albedo_field", "albedo_noise")
WRONG: dict[str, Wrong] = {
    "nothing": Wrong(off.together(), ()),
    "directions 1° each": Wrong(off.directions(_DEGREE), _one(_LIGHT)),
    "common rotation 1°": Wrong(off.rotation(_DEGREE), _one("rotation")),
    "intensities 3 %": Wrong(off.intensities(0.03), _one(_STRENGTH)),
    "ambient 1 %": Wrong(off.constant(ambient=0.01), _one(_SKY)),
    "ambient 3 %": Wrong(off.constant(ambient=0.03), _one(_SKY)),
    "black level 2 %": Wrong(off.constant(black=0.02), _one("black")),
    "vignetting 5 %": Wrong(off.constant(vignetting=0.05), _one("vignetting")),
    "vignetting 10 %": Wrong(off.constant(vignetting=0.1), _one("vignetting")),
    "radius 1 px": Wrong(off.radius(1.0), _one("radius"), ("sphere",)),
    "centre 1 px": Wrong(off.centre(1.0), _one("shift"), ("sphere",)),
    "mesh turned 1°": Wrong(off.turned(_DEGREE), _one("tilt"), ("vase",)),
    "sRGB read as 2.2": Wrong(off.constant(transfer="srgb", read_as=2.2), _one("curve")),
    "normals 1° smooth": Wrong(off.smooth_normals(_DEGREE), _one("normals")),
    "normals 1° by pixel": Wrong(off.noisy_normals(_DEGREE), _one("normal_noise")),
    "normals 2° by pixel": Wrong(off.noisy_normals(2 * _DEGREE), _one("normal_noise")),
    "albedo ±5 % smooth": Wrong(off.smooth_albedo(0.025), _one(*_ALBEDO)),
    "albedo ±20 % smooth": Wrong(off.smooth_albedo(0.1), _one(*_ALBEDO)),
    "albedo ±20 % halves": Wrong(off.two_regions(0.2), _one(*_ALBEDO)),
    "blur 0.7 px": Wrong(off.constant(blur=0.7), _one("blur")),
    "blur 1.5 px": Wrong(off.constant(blur=1.5), _one("blur")),
    "a further lobe": Wrong(off.together(), _one("lobe"), ("vase",), _two_lobes, "cook-torrance"),
    "GGX for Beckmann": Wrong(off.together(), _one("lobe"), ("vase",), _long_tailed, "cook-torrance"),
    "rough body for Lambert": Wrong(off.together(), _one("body"), ("sphere",), _rough, "lambert"),
    "directions, ambient": Wrong(
        off.together(off.directions(_DEGREE), off.constant(ambient=0.02)), (*_one(_LIGHT), *_one(_SKY))
    ),
    "intensities, albedo": Wrong(
        off.together(off.intensities(0.03), off.smooth_albedo(0.05)), (*_one(_STRENGTH), *_one(*_ALBEDO))
    ),
    "black level, blur": Wrong(off.constant(black=0.02, blur=1.0), (*_one("black"), *_one("blur"))),
    "vignetting, directions": Wrong(
        off.together(off.constant(vignetting=0.1), off.directions(_DEGREE)), (*_one("vignetting"), *_one(_LIGHT))
    ),
}


class Verdict(NamedTuple):
    """What an estimate says is wrong.

    Attributes:
        first: the cause that it names first; empty: none.
        right: whether that, or what it calls as likely, is there.
        every: whether all that is wrong is named.
    """

    first: str
    right: bool
    every: bool


def verdict(name: str, kind: str, seed: int) -> Verdict:
    """Photograph an object with something wrong, and see what the estimate says of it."""
    wrong, thing = WRONG[name], OBJECTS[kind]
    generator = np.random.default_rng([crc32(f"{name}, {kind}".encode()), seed])
    material = (wrong.material or thing.build)()
    stated = Setting(thing.surface(), light_directions(generator), np.ones(LIGHTS))
    body = "diffuse" if "diffuse" in material.parameters else "albedo"
    fixed = {name: value for name, value in thing.fixed.items() if name in material.parameters}
    with single_threaded_torch():
        capture = photograph(stated, wrong.error(stated, generator), material, body, generator)
        estimate = matest.estimate(capture, wrong.expression or material.expression, fix=fixed)
    named = [{cause.cause, *cause.others} for cause in estimate.diagnosis]
    first = estimate.diagnosis[0].cause if named else ""
    there = frozenset[str]().union(*wrong.causes)
    return Verdict(
        first=first,
        right=bool(named[0] & there) if named else not there,
        every=all(any(causes & one for one in named) for causes in wrong.causes),
    )


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every row and object, and of all together."""
    captures = CAPTURES_QUICK if effort.quick else CAPTURES
    cases = [(name, kind) for kind in OBJECTS for name, wrong in WRONG.items() if kind in wrong.objects]
    everything: list[Verdict] = []
    with processes(captures) as pool:
        for name, kind in cases:
            verdicts: list[Verdict] = []
            end = time.perf_counter() + effort.seconds / len(cases)
            for result in pool.map(verdict, [name] * captures, [kind] * captures, range(captures)):
                verdicts.append(result)
                progress(f"{kind}: {name}", len(verdicts), captures)
                if time.perf_counter() > end:
                    break
            yield from _records(name, kind, verdicts)
            everything += verdicts if len(WRONG[name].causes) == 1 else []
    right = sum(one.right for one in everything) / len(everything)
    yield Record("diagnosis", "one thing wrong", "right", right, "1", "higher", 0.9)


def _records(name: str, kind: str, verdicts: Sequence[Verdict]) -> Iterator[Record]:
    """How often the first cause is right, and all are named; where nothing is wrong, how often one is."""
    case, count = f"{kind}: {name}", len(verdicts)
    firsts = sorted({one.first or "none" for one in verdicts if not one.right})
    note = f"named instead: {', '.join(firsts)}" if firsts else ""
    yield Record("diagnosis", case, "captures", count, "1", "higher")
    if not WRONG[name].causes:
        accused = sum(bool(one.first) for one in verdicts) / count
        yield Record("diagnosis", case, "accused", accused, "1", "lower", _ACCUSED, note)
        return
    yield Record("diagnosis", case, "right", sum(one.right for one in verdicts) / count, "1", "higher", _NAMED, note)
    if len(WRONG[name].causes) > 1:
        both = sum(one.every for one in verdicts) / count
        yield Record("diagnosis", case, "both", both, "1", "higher", _BOTH)


def table(records: Sequence[Record]) -> Group:
    """One row a thing that is wrong."""
    cases: Mapping[str, Mapping[str, Record]] = by_case(records)
    about = (
        f"{LIGHTS} photographs of {SIZE}×{SIZE} pixels. Shares of captures. right: what is named first, or as likely, "
        "is there; both: both things that are wrong are named; accused: something is named though nothing is wrong."
    )
    shown = listed("what is wrong", ["captures", "right", "both", "accused"], cases)
    return page(about, shown, Text(""), records=records)


SUITE = Suite(measure, table, share=30)
