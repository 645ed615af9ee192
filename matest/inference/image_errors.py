"""What is wrong with single images: how bright each is, and where its light stands, if the others are right."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from matest.estimators import Problem, Solution, Statistics, accumulate, at_bound
from matest.estimators.calibrated import CalibratedModel
from matest.estimators.levenberg_marquardt import moved
from matest.inference.budget import by_image
from matest.samples import Batch, Groups
from matest.samples.account import CalibratedSamples
from matest.samples.calibration import Calibration, Displaced, Family
from matest.samples.tiles import in_memory

# Pixels that are enough to tell the brightness of an image to some tenths of a per cent, and samples of all images.
_PIXELS = 1_000
_SAMPLES = 12_000
# The errors of each image by itself that are looked for.
_KINDS = ("exposure", "rotation")
# Standard deviation of their priors, which keep what an image says nothing of at 0.
_ANY = 1.0
# Larger turns, rad, are not told: what they do is not in proportion.
_LARGEST_TURN = math.radians(20)
# Standard error above which it is not told how bright an image is: a single one may be of any level.
_UNKNOWN = 0.1
# Share of the information on the turn of a light about one axis below which a turn about another has no effect.
_IDLE = 1e-4
# Share of the information that is rounding, of single precision.
_ROUNDING = 1e-6
_TINY = 1e-300
# Share of its rms radiance from which on a model is bright, and how many times as bright an image may be at first.
_BRIGHT = 0.5
_BRIGHTEST = 5.0
# Share of a material's unknowns by which they move at once.
_FARTHEST = 0.2
# Walks over the samples, of which the later ones are about the errors that stand out.
_MAX_WALKS = 2


@dataclass(frozen=True, eq=False)
class ImageErrors:
    """What each of I images says of its own light, where the material is that of the others.

    Attributes:
        images: position among the fitted ones, int64 [I]; those without a usable value are left out.
        excess: share by which an image is brighter than it should be [I]; NaN where the others do not tell.
        excess_std: its standard error [I]; NaN likewise.
        turn: rotation of its lights about x, y and z that explains its residual best, rad [I, 3]; NaN where it has no
            light, or only a large one would.
        turn_std: standard error of the angle, rad [I]; NaN likewise.
        left: mean squared residual that these errors leave, in units of the noise variance; of outliers as if each were
            only just one [I].
        freed: whether an image's errors were allowed for in what the others say [I].
    """

    images: Tensor
    excess: Tensor
    excess_std: Tensor
    turn: Tensor
    turn_std: Tensor
    left: Tensor
    freed: Tensor

    @property
    def angle(self) -> Tensor:
        """By how much the lights turn, rad [I]."""
        return self.turn.norm(dim=1).atan()


# Which of the images stands out most, if any does: its row.
Odd = Callable[[ImageErrors], int | None]


def few_samples(samples: CalibratedSamples, seed: int) -> tuple[Batch, float]:
    """The samples of all images at some random pixels that tell of single images, and by how much there are more."""
    return samples.of_pixels(max(min(_PIXELS, _SAMPLES // samples.groups.images), 1), seed)


def image_errors(solution: Solution, samples: CalibratedSamples, drawn: tuple[Batch, float], odd: Odd) -> ImageErrors:
    """The errors of each image by itself, from a random part of the samples.

    The first to stand out is freed, which changes what is expected of the others, then the next. Errors of the
    calibration that were refined stay where they are.

    Args:
        solution: of the fit.
        samples: that were fitted.
        drawn: `few_samples` of these.
        odd: tells which image stands out.
    """
    own = _OwnErrors.of(solution.problem, samples)
    problem = solution.problem.calibrated(
        own, dict.fromkeys((family.name for family in own.families), _ANY), samples.groups
    ).with_priors(solution.problem.spreads)
    batch, share = by_image(drawn[0], samples.groups), 1 / drawn[1]
    unknowns = torch.cat([solution.unknowns, problem.anywhere[solution.problem.size :]])
    unknowns = _by_typical_brightness(problem, unknowns, batch)
    for _ in range(_MAX_WALKS):
        sums = accumulate(problem, unknowns, in_memory([batch]), unknowns, solution.residual_scale)
        walk = _Walk(solution, problem, unknowns, sums, share)
        found, unknowns = walk.errors(odd)
        if not bool(found.freed.any()):
            break
    return found


@dataclass(frozen=True, eq=False)
class _OwnErrors:
    """The errors of each image by itself, beside families that a fit has refined.

    Attributes:
        shared: what errors of all these families do.
        refined: names of those that the fit has refined.
        kinds: names of those that each image has.
        groups: of the samples.
    """

    shared: Calibration
    refined: Sequence[str]
    kinds: Sequence[str]
    groups: Groups

    @classmethod
    def of(cls, problem: Problem, samples: CalibratedSamples) -> _OwnErrors:
        refined = [block.name for block in problem.nuisances]
        kinds = [name for name in _KINDS if name in samples.calibration_names]
        names = [*refined, *(name for name in kinds if name not in refined)]
        return cls(samples.calibration(names), refined, kinds, samples.groups)

    @cached_property
    def families(self) -> list[Family]:
        """Those of the fit, then of each kind as many unknowns as there are images."""
        by_name = {family.name: family for family in self.shared.families}
        own = []
        for name in self.kinds:
            family = by_name[name]
            width, images = family.width, self.groups.images
            places = width * self.groups.image[:, None] + torch.arange(width)
            own.append(replace(family, name=_own(name), count=width * images, places=places))
        return [*(by_name[name] for name in self.refined), *own]

    def displaced(self, batch: Batch, values: Tensor) -> Displaced:
        """See `Calibration`: errors of an image add to refined ones of the same kind."""
        widths = [family.width for family in self.families]
        parts = dict(zip((family.name for family in self.families), values.split(widths, dim=1), strict=True))
        columns = [
            sum((parts[name] for name in (family.name, _own(family.name)) if name in parts), torch.zeros(()))
            for family in self.shared.families
        ]
        return self.shared.displaced(batch, torch.cat(columns, dim=1))


def _own(kind: str) -> str:
    """The name of the errors of each image by itself."""
    return f"{kind} of each image"


def _by_typical_brightness(problem: Problem, unknowns: Tensor, batch: Batch) -> Tensor:
    """Unknowns [P] under which each image is as bright as most of its values: an odd one's are no outliers then."""
    model = CalibratedModel(problem, unknowns).radiance(batch).mean(1)
    measured, image = batch.radiance.mean(1), problem.groups.image_of(batch)
    start, out = problem.where[_own(_KINDS[0])].start, unknowns.clone()
    for each in image.unique().tolist():
        seen = model[image == each]
        # Where the model is dark, noise is all that there is.
        bright = seen > _BRIGHT * seen.square().mean().sqrt()
        if bool(bright.any()):
            ratio = measured[image == each][bright] / seen[bright]
            out[start + each] = float(ratio.median().clamp(0, _BRIGHTEST)) - 1
    return out


def _inverse(information: Tensor, free: Tensor) -> Tensor:
    """The inverse [P, P] over the unknowns that are free [P]; directions of no information are as good as free."""
    informed = free & (information.diagonal() > 0)
    scale = torch.where(informed, information.diagonal().clamp(min=_TINY).rsqrt(), 0.0)
    scaled = information * scale[:, None] * scale + _ROUNDING * torch.eye(len(scale), dtype=torch.float64)
    return torch.linalg.inv(scaled) * scale[:, None] * scale


def _own_places(problem: Problem, images: Tensor) -> Tensor:
    """Positions in u of the errors of some images [I, 4], or [I, 1] where no image has a light."""
    kinds = [problem.where[name] for kind in _KINDS if (name := _own(kind)) in problem.where]
    widths = [problem.family(_own(kind)).width for kind in _KINDS if _own(kind) in problem.where]
    parts = [
        place.start + width * images[:, None] + torch.arange(width) for place, width in zip(kinds, widths, strict=True)
    ]
    return torch.cat(parts, dim=1)


class _OfImage(NamedTuple):
    """What one image says.

    Attributes:
        errors: of the image [q].
        stds: standard errors of the excess and of the angle, where residuals are as large as they are [1 or 2].
        left: see `ImageErrors`.
    """

    errors: Tensor
    stds: Tensor
    left: float


class _Walk:
    """The images' errors to first order about some unknowns, without the material's, which follow."""

    def __init__(self, solution: Solution, problem: Problem, unknowns: Tensor, sums: Statistics, share: float) -> None:
        size = solution.problem.size
        self._problem, self._unknowns, self._size, self._sums = problem, unknowns, size, sums
        information, gradient = replace(sums, prior=None).information, replace(sums, prior=None).gradient
        prior = problem.prior_terms(unknowns)
        if prior is not None:
            # The samples are a part of those that the priors were weighed against.
            information, gradient = information + share * prior.precision, gradient + share * prior.pull
        free = ~at_bound(solution.problem, unknowns[:size], gradient[:size])
        for block in solution.problem.nuisances:
            free[solution.problem.where[block.name]] = False
        inverse = _inverse(information[:size, :size], free)
        cross = information[size:, :size]
        self._gain = inverse @ cross.T
        self._step = inverse @ gradient[:size]
        rounding = _ROUNDING * information[size:, size:].diagonal().diag()
        self._information = information[size:, size:] - cross @ self._gain + rounding
        # What the slope is where no image has errors of its own.
        at_zero = gradient[size:] - cross @ self._step
        self._slope = at_zero + self._information @ unknowns[size:]
        self._images = problem.groups.image[sums.labels]
        self._own = _own_places(problem, self._images) - size
        self._without_idle_turns()

    def _without_idle_turns(self) -> None:
        """Hold turns at 0 that have no effect: a distant light may turn about its own direction."""
        inside = torch.eye(len(self._slope), dtype=torch.float64)
        for turn in self._own[:, 1:]:
            if len(turn):
                values, vectors = torch.linalg.eigh(self._information[turn][:, turn])
                vectors = vectors[:, values > _IDLE * values.max()]
                inside[turn[:, None], turn] = vectors @ vectors.T
        self._information = inside @ self._information @ inside + torch.eye(len(inside)) - inside
        self._slope = inside @ self._slope

    def errors(self, odd: Odd) -> tuple[ImageErrors, Tensor]:
        """The errors of the images, and the unknowns [P] to walk about next."""
        freed: list[int] = []
        found = self._with(freed)
        while (row := odd(found)) is not None:
            freed.append(row)
            found = self._with(freed)
        values = torch.zeros(len(self._slope), dtype=torch.float64)
        for row in freed:
            values[self._own[row]] = self._values(found, row)
        material = self._step - self._gain @ (values - self._unknowns[self._size :])
        # Far away nothing is linear.
        farthest = _FARTHEST * (self._unknowns[: self._size].abs() + _FARTHEST)
        material = material / max(float((material.abs() / farthest).max()), 1.0)
        unknowns = moved(self._problem, self._unknowns, torch.cat([material, torch.zeros_like(values)]))
        for row in range(len(found.images)):
            unknowns[self._size + self._own[row]] = self._values(found, row)
        return found, unknowns

    def _values(self, found: ImageErrors, row: int) -> Tensor:
        """The errors of an image, in the order of its unknowns."""
        return torch.cat([found.excess[row, None], found.turn[row]]).nan_to_num()[: self._own.shape[1]]

    def _with(self, freed: Sequence[int]) -> ImageErrors:
        """The errors of each image where only it and some others have any."""
        count = len(self._images)
        values, stds = (torch.full((count, size), math.nan, dtype=torch.float64) for size in (4, 2))
        left, is_freed = torch.zeros(count, dtype=torch.float64), torch.zeros(count, dtype=torch.bool)
        is_freed[[*freed]] = True
        for row in range(count):
            others = self._own[[other for other in freed if other != row]].flatten()
            own = self._of_image(row, self._own[row], others)
            if not float(own.errors[1:].norm()) < _LARGEST_TURN or not bool((own.stds[1:] < _LARGEST_TURN).all()):
                own = self._of_image(row, self._own[row, :1], others)
            values[row, : len(own.errors)], stds[row, : len(own.stds)], left[row] = own
        unknown = ~(stds[:, 0] < _UNKNOWN)
        values[unknown, 0] = stds[unknown, 0] = math.nan
        return ImageErrors(self._images, values[:, 0], stds[:, 0], values[:, 1:], stds[:, 1], left, is_freed)

    def _of_image(self, row: int, places: Tensor, others: Tensor) -> _OfImage:
        """The errors of an image at some places, where the unknowns of others are free beside them."""
        every = torch.cat([places, others])
        inverse = torch.linalg.inv(self._information[every][:, every])
        errors, covariance = (inverse @ self._slope[every])[: len(places)], inverse[: len(places), : len(places)]
        change = errors - self._unknowns[self._size + places]
        gain = float(change @ torch.linalg.solve(covariance, change))
        chi2, values, rejected, outliers = (
            float(self._sums.column(name)[row]) for name in ("chi2", "values", "rejected", "outliers")
        )
        inflation = max((chi2 - gain) / max(values, 1.0), 1.0)
        variances = [covariance[0, 0]]
        if len(errors) > 1:
            toward, of_turn = torch.nn.functional.normalize(errors[1:], dim=0), covariance[1:, 1:]
            variances.append(toward @ of_turn @ toward if bool(toward.any()) else of_turn.diagonal().max())
        left = max(chi2 - gain + rejected, 0.0) / max(values + outliers, 1.0)
        return _OfImage(errors, (inflation * torch.stack(variances)).sqrt(), left)
