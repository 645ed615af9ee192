"""Whether `auto` finds the components of simulated materials, how well it predicts, and its time against naming it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from rich.console import Group
from rich.text import Text

import matest
from matest.benchmark.instruments.photographs import Sensor, Subject, sphere, subject
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, listed, page
from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar, TorranceSparrow
from matest.brdf.presets import preset
from matest.capture import Capture
from matest.estimation.options import Options
from matest.estimation.recipes import Component
from matest.estimation.selection import select
from matest.estimation.verdict import equivalents
from matest.photographs.noise import Noise
from matest.spectra import metal_colour
from matest.workers import processes, single_threaded_torch

CAPTURES = 100
CAPTURES_QUICK = 2
# Pixels on a side, photographs that are fitted, and further ones that are predicted.
SIZE = 64
FITTED = 6
PREDICTED = 2
# The farthest that a light stands off the camera, degrees.
_OBLIQUE = 70.0
# Half a per cent of full scale, and hardly any shot noise.
_NOISE = Noise(read=0.005, gain=1e-6)
_C = Component
# Albedo of a body in each channel.
_BODY = [0.5, 0.3, 0.2]
_FACETS = [0.7, 0.5, 0.3]
# Reflectance of aluminium at normal incidence.
_ALUMINIUM = [0.91, 0.92, 0.92]


def _model(kind: Callable[..., Brdf], **values: Any) -> Brdf:
    """A model from numbers, which its constructor turns into tensors."""
    return kind(**values)


def _metal(**values: Any) -> Brdf:
    return _model(CookTorrance, diffuse=0.0, specular=1.0, fresnel="schlick", **values)


def _copper() -> list[float]:
    colour: list[float] = metal_colour("copper").clamp(max=1).tolist()
    return colour


def _sheen() -> Brdf:
    return _model(OrenNayar, albedo=_FACETS, sigma=0.35) + _model(TorranceSparrow, specular=0.05, sigma=0.35)


class Truth(NamedTuple):
    """A material and what `auto` should find of it.

    Attributes:
        build: makes it.
        components: that it has, as far as photographs from the camera's side show them.
        expression: that names its model; values in brackets are held.
        fixed: parameters that whoever names the model fixes at their true value.
    """

    build: Callable[[], Brdf]
    components: frozenset[Component]
    expression: str
    fixed: tuple[str, ...] = ()


def _truth(build: Callable[[], Brdf], expression: str, *components: Component, fixed: tuple[str, ...] = ()) -> Truth:
    return Truth(build, frozenset(components), expression, fixed)


TRUTHS: dict[str, Truth] = {
    "lambert": _truth(lambda: _model(Lambert, albedo=_BODY), "lambert", _C.BODY),
    "oren-nayar, 20°": _truth(
        lambda: _model(OrenNayar, albedo=_FACETS, sigma=math.radians(20)), "oren-nayar", _C.BODY, _C.ROUGHNESS
    ),
    "oren-nayar, 40°": _truth(
        lambda: _model(OrenNayar, albedo=_FACETS, sigma=math.radians(40)), "oren-nayar", _C.BODY, _C.ROUGHNESS
    ),
    "rough with sheen": _truth(_sheen, "oren-nayar+torrance-sparrow", _C.BODY, _C.ROUGHNESS, _C.GLOSS),
    "gloss, m 0.1": _truth(
        lambda: _model(CookTorrance, diffuse=_BODY, specular=0.9, slope=0.1, f0=0.04), "cook-torrance", _C.BODY,
        _C.GLOSS,
    ),
    "gloss, m 0.3": _truth(
        lambda: _model(CookTorrance, diffuse=_BODY, specular=0.9, slope=0.3, f0=0.04), "cook-torrance", _C.BODY,
        _C.GLOSS,
    ),
    "copper": _truth(lambda: _metal(slope=0.3, f0=_copper()), "cook-torrance(fresnel=schlick,diffuse=0)", _C.METAL),
    "aluminium": _truth(
        lambda: _metal(slope=0.2, f0=_ALUMINIUM), "cook-torrance(fresnel=schlick,diffuse=0)", _C.METAL
    ),
    "copper, two slopes": _truth(
        lambda: _metal(slope=0.1, slope_2=0.4, weight_2=0.6, lobes="2", f0=_copper()),
        "cook-torrance(lobes=2,fresnel=schlick,diffuse=0)", _C.METAL, _C.SECOND_LOBE,
    ),
    "ground glass #41": _truth(
        lambda: preset("ground-glass"), "li-torrance(uniform=on,subsurface=off)", _C.METAL, _C.MULTIPLE, fixed=("f0",)
    ),
    "red paint #13": _truth(lambda: preset("red-paint"), "li-torrance", _C.COAT, _C.GLOSS, fixed=("f0",)),
    "laser paper #73": _truth(lambda: preset("laser-paper"), "li-torrance", _C.COAT, _C.GLOSS, fixed=("f0",)),
}  # fmt: skip
# Share of captures whose components are found, or named as not told apart; share of those predicted as well as by the
# true model; times of naming the model that choosing it may cost.
LIMITS = {"right": 0.92, "predicted": 0.95, "auto / named": 3.0}
# Pixels on a side of a patch of an object in patches.
_PATCH = 10
# Radiance of every other patch relative to that of the rest.
_DARK_PATCH = 0.6
# Ratio of the error on photographs left out to that of the true model that counts as equal.
_EQUAL_ERROR = 1.1


@dataclass(frozen=True)
class Choice:
    """What `auto` makes of one capture.

    Attributes:
        expression: of the model that it chooses.
        right: whether its components, or those of a model that it calls equal, are those of the truth.
        error: on photographs left out, relative to that of the true model.
        ratio: of its time to that of the model it chooses when named.
    """

    expression: str
    right: bool
    error: float
    ratio: float


def _in_wrong_order(photographed: Subject) -> Capture:
    """Photographs whose lights are those of the next."""
    capture = photographed.photograph()
    lights = capture.photographs.scene.lights
    scene = replace(capture.photographs.scene, lights=(*lights[1:], lights[0]))
    return replace(capture, photographs=replace(capture.photographs, scene=scene))


def _in_patches(photographed: Subject) -> Capture:
    """Photographs of a chequered object."""
    rows, columns = np.divmod(photographed.scene.surface.pixels, SIZE)
    dark = (rows // _PATCH + columns // _PATCH) % 2 == 1
    shade = np.where(dark, _DARK_PATCH, 1.0)[:, None]
    return replace(photographed, radiance=tuple(image * shade for image in photographed.radiance)).photograph()


# Materials that are bright on all sides: of a metal under lights in a wrong order a model may meet no value at all.
_BODIES = [name for name, truth in TRUTHS.items() if _C.BODY in truth.components]
# What keeps every model from holding.
MISFITS: dict[str, Callable[[Subject], Capture]] = {
    "lights in a wrong order": _in_wrong_order,
    "albedo in patches": _in_patches,
}


def cost_without_model(misfit: str, seed: int) -> float:
    """Time to choose and fit a model where none holds, relative to that of the chosen one when named."""
    name = _BODIES[seed % len(_BODIES)]
    generator = np.random.default_rng([seed, len(name)])
    photographed = subject(
        sphere(SIZE), _lights(generator, FITTED), TRUTHS[name].build(), Sensor(noise=_NOISE), seed=seed
    )
    with single_threaded_torch():
        capture = MISFITS[misfit](photographed)
        started = time.process_time()
        selection = select(capture.photographs.samples(distinct=True), Options())
        chosen = time.process_time()
        matest.estimate(capture, selection.best.recipe.expression)
        ended = time.process_time()
    return (ended - started) / max(ended - chosen, 1e-9)


def choice(name: str, seed: int) -> Choice:
    """Photograph a material under random lights, choose its model, and predict photographs left out."""
    truth = TRUTHS[name]
    generator = np.random.default_rng([seed, len(name)])
    material = truth.build()
    with single_threaded_torch():
        capture = subject(
            sphere(SIZE), _lights(generator, FITTED + PREDICTED), material, Sensor(noise=_NOISE), seed=seed
        ).photograph()
        holdout = range(FITTED, FITTED + PREDICTED)
        started = time.process_time()
        samples = capture.photographs.samples(tuple(range(FITTED)), distinct=True)
        selection = select(samples, Options(holdout=holdout))
        chosen = time.process_time()
        estimate = matest.estimate(capture, selection.best.recipe.expression, holdout=holdout)
        ended = time.process_time()
        fix = {key: material.parameters[key].tolist() for key in truth.fixed}
        named = matest.estimate(capture, truth.expression, fix=fix, holdout=holdout)
    plausible = [selection.best, *equivalents(selection.best, selection.trials)]
    assert estimate.holdout is not None
    assert named.holdout is not None
    return Choice(
        expression=selection.best.recipe.expression,
        right=any(trial.recipe.components == truth.components for trial in plausible),
        error=estimate.holdout["relative_rmse"] / named.holdout["relative_rmse"],
        ratio=(ended - started) / max(ended - chosen, 1e-9),
    )


def _lights(generator: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors [count, 3], evenly drawn within `_OBLIQUE` of the camera."""
    z = 1 - generator.random(count) * (1 - math.cos(math.radians(_OBLIQUE)))
    turn, across = 2 * math.pi * generator.random(count), np.sqrt(1 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every material."""
    captures = CAPTURES_QUICK if effort.quick else CAPTURES
    with processes(captures) as pool:
        for name in TRUTHS:
            choices: list[Choice] = []
            end = time.perf_counter() + effort.seconds / len(TRUTHS)
            for result in pool.map(choice, [name] * captures, range(captures)):
                choices.append(result)
                progress(name, len(choices), captures)
                if time.perf_counter() > end:
                    break
            yield from _records(name, choices)
        for misfit in MISFITS:
            progress(misfit)
            count = captures if effort.quick else len(_BODIES)
            ratios = [*pool.map(cost_without_model, [misfit] * count, range(count))]
            yield _time(misfit, ratios)


def _records(name: str, choices: Sequence[Choice]) -> Iterator[Record]:
    wrong = sorted({one.expression for one in choices if not one.right})
    note = f"also chosen: {', '.join(wrong)}" if wrong else ""
    right, predicted = (
        float(np.mean(flags)) for flags in ([c.right for c in choices], [c.error < _EQUAL_ERROR for c in choices])
    )
    yield Record("selection", name, "captures", len(choices), "1", "higher")
    yield Record("selection", name, "right", right, "1", "higher", LIMITS["right"], note)
    yield Record("selection", name, "predicted", predicted, "1", "higher", LIMITS["predicted"])
    yield _time(name, [one.ratio for one in choices])


def _time(case: str, ratios: Sequence[float]) -> Record:
    return Record("selection", case, "auto / named", float(np.median(ratios)), "1", "lower", LIMITS["auto / named"])


def table(records: Sequence[Record]) -> Group:
    """Shares of captures, and times."""
    cases = by_case(records)
    about = (
        f"Spheres of {SIZE}×{SIZE} pixels under {FITTED} lights within {_OBLIQUE:g}° of the camera, noise of half a "
        f"per cent of full scale. Limits: right {LIMITS['right']:g}, predicted {LIMITS['predicted']:g}, auto / named "
        f"{LIMITS['auto / named']:g}."
    )
    legend = (
        "Right: the components are those of the material, or of a model that the result calls equal. Predicted: the "
        f"error on {PREDICTED} photographs left out is below {_EQUAL_ERROR:g} times that of the true model. No model "
        "holds for the last two, whose materials are the bodies above in turn."
    )
    metrics = ("captures", "right", "predicted", "auto / named")
    return page(about, listed("material", metrics, cases), "", Text(legend), records=records)


SUITE = Suite(measure, table, share=90)
