"""How often the 95 % intervals of maps, and of what all pixels share, hold the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from matest.benchmark.instruments.photographs import sphere, vase
from matest.benchmark.instruments.pooling import ENOUGH, resampled
from matest.benchmark.instruments.varying import KINDS, Kind, estimated, photographed, tells
from matest.benchmark.suite import Record
from matest.brdf import Brdf
from matest.estimation.parameter_map import TexelStatus
from matest.estimation.result import Estimate
from matest.scene import Surface
from matest.workers import single_threaded_torch

OBJECTS: dict[str, Callable[[int], Surface]] = {"sphere": sphere, "vase": vase}
# Photographs of a capture; and of one that has few.
IMAGES = 12
FEW = 3
# Groups of intervals, and the attribute of `Coverage` that has them.
GROUPS = {"own": "own", "all": "every", "shared": "shared"}
# Least and most coverage.
LIMITS = (0.93, 0.97)
# Standard errors that an interval reaches to either side.
_REACH = 1.96


class Setting(NamedTuple):
    """Captures of one sort.

    Attributes:
        shape: name of the object.
        kind: name of the material.
        lights: number of photographs.
        materials: 2: of two uniform materials; None: varying smoothly.
    """

    shape: str
    kind: str
    lights: int = IMAGES
    materials: int | None = None

    @property
    def case(self) -> str:
        """For the records."""
        of = "" if self.materials is None else f" ({self.materials} materials, {self.lights} images)"
        return f"{self.shape}: {self.kind}{of}"


SMOOTH = tuple(Setting(shape, kind) for shape in OBJECTS for kind in KINDS)
TWO_MATERIALS = tuple(Setting("sphere", kind, FEW, 2) for kind in ("cook-torrance", "oren-nayar"))


class Hits(NamedTuple):
    """Some intervals.

    Attributes:
        inside: number of those that hold the truth.
        total: number of all.
    """

    inside: int
    total: int

    @classmethod
    def among(cls, flags: Tensor) -> Hits:
        """Of flags of any shape."""
        return cls(int(flags.sum()), flags.numel())


@dataclass(frozen=True)
class Coverage:
    """How many intervals hold the truth in the estimate of one capture.

    Attributes:
        own: of the pixels that tell their own value, by mapped parameter; a value a channel.
        every: of all pixels that are seen, likewise.
        shared: of the parameters in common, by name.
        deviations: errors of these in standard errors, a channel each; those without error bar are left out.
        chi2: per degree of freedom.
    """

    own: Mapping[str, Hits]
    every: Mapping[str, Hits]
    shared: Mapping[str, Hits]
    deviations: Mapping[str, list[float]]
    chi2: float


def coverage_of(kind: Kind, estimate: Estimate, truth: Brdf) -> Coverage:
    """Which intervals of an estimate with maps hold the truth; one that is not there does not."""
    own, every = {}, {}
    for name, each in estimate.maps.items():
        flags = (each.value.double() - truth.parameters[name]).abs() <= _REACH * each.std
        own[name], every[name] = Hits.among(flags[tells(each)]), Hits.among(flags[each.status != TexelStatus.UNSEEN])
    shared, deviations = {}, {}
    for name in kind.shared:
        found, true = estimate.parameters[name], torch.atleast_1d(truth.parameters[name]).tolist()
        ends, values, stds = (
            one if isinstance(one, list) and isinstance(found.value, list) else [one] * len(true)
            for one in (found.interval95, found.value, found.std)
        )
        inside = [pair is not None and pair[0] <= right <= pair[1] for pair, right in zip(ends, true, strict=True)]
        shared[name] = Hits(sum(inside), len(inside))
        of_channels = zip(values, stds, true, strict=True)
        deviations[name] = [(value - right) / std for value, std, right in of_channels if std is not None]
    return Coverage(own, every, shared, deviations, estimate.fit.reduced_chi2)


def trial(setting: Setting, side: int, seed: int) -> Coverage:
    """Draw, photograph, estimate and compare: images of `side` pixels; the same seed draws the same."""
    kind = KINDS[setting.kind]
    with single_threaded_torch():
        surface = OBJECTS[setting.shape](side)
        subject = photographed(kind, surface, setting.lights, seed, materials=setting.materials)
        estimate = estimated(kind, subject.photograph())
        return coverage_of(kind, estimate, subject.material)


def records(suite: str, case: str, some: Sequence[Coverage]) -> Iterator[Record]:
    """Coverage over all captures, with its Monte-Carlo interval; limits where there are enough captures."""
    yield Record(suite, case, "captures", len(some), "1", "higher")
    chi2 = [one.chi2 for one in some]
    note = f"worst: seed {int(np.argmax(chi2))}, {max(chi2):.3g}"
    yield Record(suite, case, "mean reduced chi2", float(np.mean(chi2)), "1", note=note)
    yield Record(suite, case, "largest reduced chi2", max(chi2), "1", note=note)
    for group, attribute in GROUPS.items():
        hits = [getattr(one, attribute) for one in some]
        for name in hits[0]:
            yield from _share(suite, case, f"{name}, {group}", [one[name] for one in hits], len(some) >= ENOUGH)
    for name in some[0].shared:
        errors = [error for one in some for error in one.deviations[name]]
        rms = math.sqrt(np.mean(np.square(errors))) if errors else None
        yield Record(suite, case, f"{name}: rms error / std", rms, "1", note="no capture has an error bar")


def _share(suite: str, case: str, what: str, hits: Sequence[Hits], judged: bool) -> Iterator[Record]:
    """A share of intervals that hold the truth, and the ends of its interval."""
    share = resampled(*(np.array(numbers) for numbers in zip(*hits, strict=True)))
    if math.isnan(share.value):
        yield Record(suite, case, f"{what}: coverage", None, "1", "higher", note="no pixel tells its own value")
        return
    note, (least, most) = f"95 % Monte-Carlo interval {share.low:.3g} to {share.high:.3g}", LIMITS
    yield Record(suite, case, f"{what}: coverage", share.value, "1", "higher", least if judged else None, note)
    if judged:
        yield Record(suite, case, f"{what}: coverage, not above", share.value, "1", limit=most, note=note)
    for end, value in (("from", share.low), ("to", share.high)):
        yield Record(suite, case, f"{what}: coverage, {end}", value, "1", "higher")
