"""One simulated capture: drawn at random, and its estimate against the truth in units of the Cramér-Rao bound."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import numpy as np
import torch
from torch import Tensor

import matest
from matest.benchmark.instruments.optimum import excess
from matest.benchmark.instruments.photographs import CLEAN, Conditions, Sensor, Subject, sphere, subject, vase
from matest.brdf import model
from matest.estimation.result import Estimate
from matest.estimators import Problem
from matest.estimators.covariance import Covariance
from matest.photographs.noise import Noise
from matest.workers import single_threaded_torch

# Pixels on a side of the images.
SIZE = 64
# The farthest that a light stands off the camera, degrees.
_OBLIQUE = 75.0
# Ranges that the truth is drawn from: (lowest, highest, logarithmic).
_RANGES = {
    "albedo": (0.1, 0.9, False),
    "sigma": (math.radians(5), math.radians(50), False),
    "diffuse": (0.05, 0.8, False),
    "specular": (0.1, 0.9, False),
    "slope": (0.05, 0.5, True),
    "k_dd": (0.1, 0.9, False),
    "k_uds": (0.05, 0.8, False),
    # rms slope 2σ/τ of 0.05 to 0.5 at the default height σ = 1 µm.
    "correlation_length": (4.0, 40.0, True),
}
# Parameters nearer than this many standard errors to an end of their domain do not count.
_FROM_BOUND = 3.0
# Nor do those whose standard error is above that of an even draw from the domain, relative to its width.
_KNOWS_NOTHING = 1 / math.sqrt(12)
# Nor those that vary over decades and whose standard error is above this share of their value.
_KNOWS_LITTLE = 0.5
# Parameters that are fixed at their true value.
_FIXED = ("f0",)


@dataclass(frozen=True)
class Figure:
    """One unknown of one capture.

    Attributes:
        label: `sigma`, `albedo[0]`.
        truth: its value.
        bound: the Cramér-Rao bound of its standard error.
        value: the estimate; None where none was given.
        interval: of 95 %; None likewise.
    """

    label: str
    truth: float
    bound: float
    value: float | None
    interval: tuple[float, float] | None

    @property
    def error(self) -> float:
        """Of the estimate, in units of the bound; NaN where there is none."""
        return math.nan if self.value is None else (self.value - self.truth) / self.bound

    @property
    def covered(self) -> bool:
        """Whether the interval holds the truth."""
        return self.interval is not None and self.interval[0] <= self.truth <= self.interval[1]


@dataclass(frozen=True)
class Trial:
    """One simulated capture.

    Attributes:
        expression: of the model.
        seed: of the draw.
        figures: the unknowns that these samples determine and whose truth lies off the ends of its domain.
        excess: χ² above the lowest on a dense grid; None where no grid was computed.
        errors: what the error bars rest on.
        about: object, lights and noise, for a person.
    """

    expression: str
    seed: int
    figures: tuple[Figure, ...]
    excess: float | None
    errors: str
    about: str

    @property
    def worst(self) -> float:
        """The largest error of an unknown, in units of its bound."""
        return max((abs(figure.error) for figure in self.figures if figure.value is not None), default=0.0)

    @property
    def uncovered(self) -> int:
        """Number of intervals that miss the truth."""
        return sum(figure.interval is not None and not figure.covered for figure in self.figures)

    @property
    def summary(self) -> str:
        """Estimate (truth) and error in units of the bound, of every unknown."""
        parts = [
            f"{f.label} not given ({f.truth:.4g})"
            if f.value is None
            else f"{f.label} {f.value:.4g} ({f.truth:.4g}), {f.error:+.1f}{'' if f.covered else ' outside'}"
            for f in self.figures
        ]
        above = [] if self.excess is None else [f"χ² {self.excess:+.2g} from the grid's lowest"]
        return "; ".join([*parts, *above, f"error bars: {self.errors}"])

    def only(self, name: str) -> Trial:
        """The same capture with the unknowns of one parameter."""
        return replace(self, figures=tuple(f for f in self.figures if f.label.partition("[")[0] == name))


def trial(expression: str, seed: int, conditions: Conditions = CLEAN, grid: bool = True) -> Trial:
    """Draw, photograph, estimate and compare; with `grid`, look on a dense grid for an optimum below the estimate."""
    # Images are too small to be worth several threads.
    with single_threaded_torch():
        try:
            return _trial(draw(expression, seed, conditions), grid)
        except Exception as error:
            error.add_note(f"in the capture of {expression} with seed {seed}, {conditions}")
            raise


def again(expression: str, seed: int, conditions: Conditions = CLEAN, grid: bool = True) -> str:
    """One capture once more, as a sentence: to look into a failure that a suite names by its seed."""
    one = trial(expression, seed, conditions, grid)
    return f"{expression}, seed {seed} ({one.about}): {one.summary}"


def _trial(drawn: Subject, grid: bool) -> Trial:
    expression, parameters = drawn.material.expression, drawn.material.parameters
    fix = {name: parameters[name].tolist() for name in _FIXED if name in drawn.material.declared}
    capture, problem = drawn.photograph(), drawn.problem(fix)
    covariance = drawn.cramer_rao(problem)
    estimate = matest.estimate(capture, expression, fix=fix)
    above = None
    if grid:
        unknowns = problem.unknowns_at(estimate.material.parameters)
        above = excess(problem, unknowns, capture.samples(dtype=torch.float64))
    figures = tuple(_figures(problem, problem.unknowns_at(parameters), covariance, estimate))
    return Trial(expression, drawn.seed, figures, above, estimate.fit.errors, _about(drawn))


def draw(expression: str, seed: int, conditions: Conditions = CLEAN) -> Subject:
    """Draw at random: sphere or vase; 1, 3 or 12 lights; one channel or three; material, noise and exposure.

    The same seed draws the same. Parameters without a range of their own keep their defaults.
    """
    generator = np.random.default_rng([crc32(expression.encode()), seed])
    brdf = model(expression)[0]
    channels = int(generator.choice((1, 3)))
    values = {}
    for name, declared in brdf.declared.items():
        if name in _RANGES:
            low, high, log = _RANGES[name]
            share = generator.random(channels if declared.per_channel else 1)
            value = low * (high / low) ** share if log else low + (high - low) * share
            values[name] = torch.as_tensor(value if declared.per_channel else value[0])
    surface = (sphere, vase)[generator.integers(2)](SIZE)
    lights = np.array([_direction(generator) for _ in range(generator.choice((1, 3, 12)))])
    sensor = Sensor(
        noise=Noise(5e-4 * 10 ** generator.random(), 1e-5 * 100 ** generator.random()),
        black=float(generator.choice((0.0, 0.03))),
        exposed=0.5 + 0.4 * generator.random(),
        conditions=conditions,
    )
    return subject(surface, lights, brdf.replace(values), sensor, channels=channels, seed=seed)


def _direction(generator: np.random.Generator) -> list[float]:
    """A unit vector, evenly drawn within `_OBLIQUE` of the camera."""
    z = 1 - generator.random() * (1 - math.cos(math.radians(_OBLIQUE)))
    turn = 2 * math.pi * generator.random()
    across = math.sqrt(1 - z * z)
    return [across * math.cos(turn), across * math.sin(turn), z]


def _figures(problem: Problem, truth: Tensor, bound: Covariance, estimate: Estimate) -> Iterator[Figure]:
    """The unknowns that the samples determine and whose truth lies off the ends of its domain."""
    for name, place in problem.where.items():
        domain, declared = problem.domain(name), problem.declared(name)
        # Of some parameters a quantity derived from them and others is known, and reported.
        quantity = next((derived for derived in problem.brdf.derived.values() if derived.sets == name), None)
        label = name if quantity is None else quantity.name
        reported = estimate.parameters[label]
        count = place.stop - place.start
        pair: tuple[Any, Any] = (reported.value, reported.interval95)
        values, ends = (one if isinstance(reported.value, list) else [one] * count for one in pair)
        for channel, position in enumerate(range(place.start, place.stop)):
            true, std = float(truth[position]), float(bound.std[position])
            little = min(_KNOWS_NOTHING * domain.width, _KNOWS_LITTLE * true if declared.log else math.inf)
            off = min(true - domain.lower, domain.upper - true)
            if bool(bound.undetermined[position]) or std > little or off < _FROM_BOUND * std:
                continue
            if quantity is not None:
                at = {**problem.held, name: truth[position]}
                true, std = float(quantity.value(at)), std * abs(quantity.slopes(at)[name])
            index = "" if count == 1 else f"[{channel}]"
            interval = None if ends[channel] is None else tuple(ends[channel])
            yield Figure(f"{label}{index}", true, std, values[channel], interval)


def _about(drawn: Subject) -> str:
    scene, noise = drawn.scene, drawn.sensor.noise
    shape = "sphere" if scene.surface.mesh is None else "vase"
    lights = f"{len(scene)} light" + ("s" if len(scene) > 1 else "")
    return f"{shape}, {lights}, {scene.channels} channels, read {noise.read:.2g}, gain {noise.gain:.2g}"
