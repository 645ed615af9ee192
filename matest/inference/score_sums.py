"""What samples say, to first order, of errors that a fit leaves out: scores and information of families of columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor

from matest.brdf import Brdf, CookTorrance, OrenNayar
from matest.estimators import Problem, Solution, at_bound
from matest.estimators.calibrated import CalibratedModel, Tangent
from matest.samples import Batch, Tile
from matest.scene import Points
from matest.shading import shade
from matest.workers import single_threaded_torch

# Families of what a model may lack: further lobes, and a diffuse body that scatters by another law.
LOBE, BODY = "lobe", "body"
# Shapes of further lobes: slopes of Gaussian ones and of ones with long tails, from the sharpest that photographs show.
_SLOPES, _TAILED_SLOPES = (0.03, 0.06, 0.12, 0.25, 0.5), (0.05, 0.15, 0.4)
# Roughnesses of further bodies, rad.
_ROUGHNESSES = (0.3, 0.8)
# Eigenvalue of the scaled information. Combinations with a smaller one are not told apart: it is the rounding of single
# precision.
_UNSEEN = 1e-6
# Share of the information on a family that is rounding where what was fitted explains the rest.
_ROUNDING = 1e-5


class PixelSums(NamedTuple):
    """Sums of a family of which every pixel has k unknowns of its own.

    Attributes:
        information: [P, k, k].
        scores: [P, k].
    """

    information: Tensor
    scores: Tensor


class Spectrum(NamedTuple):
    """A family in coordinates in which its information is diagonal, everything that was fitted being free to follow.

    Attributes:
        information: [m].
        squares: squared scores [m].
    """

    information: Tensor
    squares: Tensor


@dataclass(frozen=True, eq=False)
class ScoreSums:
    """Sums over some samples at a solution, in units of the noise.

    Attributes:
        information: of N unknowns: those of the fit come first [N, N].
        scores: JᵀWr [N].
        fitted: unknowns of the fit that are free to follow [M].
        alone: for each image the unknowns outside the fit that no other image touches: no term joins those of two.
        places: of the unknowns of each family that is not in the fit, by name.
        by_pixel: sums of families of single pixels, by name.
        units: what one standard deviation of the errors as a whole is of each unknown of a family, by name.
        cost: χ².
        values: number of values.
    """

    information: Tensor
    scores: Tensor
    fitted: Tensor
    alone: Sequence[Tensor]
    places: Mapping[str, slice]
    by_pixel: Mapping[str, PixelSums]
    units: Mapping[str, float]
    cost: float
    values: int

    @property
    def chi2(self) -> float:
        """Per value."""
        return self.cost / max(self.values, 1)

    @property
    def families(self) -> list[str]:
        return [*self.places, *self.by_pixel]

    def spectrum(self, name: str) -> Spectrum:
        """A family by itself, beside what was fitted."""
        if name in self.by_pixel:
            # What is fitted follows the errors of single pixels as little as one pixel follows another's.
            information, scores = self.by_pixel[name]
            values, vectors = torch.linalg.eigh(information)
            return Spectrum(values.flatten(), (vectors.mT @ scores[..., None]).flatten().square())
        place = self.places[name]
        cross = self.information[self.fitted][:, place]
        followed = self._fitted_inverse(cross)
        own = self.information[place, place]
        information = own - cross.T @ followed
        scores = self.scores[place] - followed.T @ self.scores[self.fitted]
        values, vectors = torch.linalg.eigh((information + information.T) / 2)
        # Of what the fit can do as well only rounding is left.
        seen = values > _ROUNDING * own.diagonal().max()
        return Spectrum(torch.where(seen, values, 0.0), torch.where(seen, (vectors.T @ scores).square(), 0.0))

    def chi2_with_everything(self) -> float:
        """χ² per value if errors of all families but those of single pixels had their best values.

        Unknowns of single images are eliminated image by image, for the work of an inverse grows with the cube.
        """
        free = torch.zeros(len(self.scores), dtype=torch.bool)
        free[self.fitted] = True
        for place in self.places.values():
            free[place] = True
        scale = _scale(self.information)
        scores = scale * self.scores
        images = [image[free[image]] for image in self.alone]
        own = torch.cat([self.fitted[:0], *images])
        free[own] = False
        shared = free.nonzero()[:, 0]
        cross = torch.column_stack([self._scaled(scale, own, shared), scores[own]])
        parts = cross.split([len(image) for image in images])
        followed = torch.cat(
            [
                cross[:0],
                *(
                    _Inverse.of(self._scaled(scale, image, image))(part)
                    for image, part in zip(images, parts, strict=True)
                ),
            ]
        )
        taken = cross.T @ followed
        rest = scores[shared] - taken[:-1, -1]
        inverse = _Inverse.of(self._scaled(scale, shared, shared) - taken[:-1, :-1])
        gain = float(taken[-1, -1] + rest @ inverse(rest))
        return max(self.cost - gain, 0.0) / max(self.values, 1)

    def _scaled(self, scale: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        """A part of the information, of unknowns in other units."""
        return scale[rows, None] * self.information[rows[:, None], columns] * scale[columns]

    @cached_property
    def _fitted_inverse(self) -> _Inverse:
        information = self.information[self.fitted][:, self.fitted]
        return _Inverse.of(information, _scale(information))


class _Inverse(NamedTuple):
    """The inverse of an information of M unknowns; combinations that are not seen stay where they are.

    Attributes:
        vectors: of the scaled information, as columns, each times what scales its unknowns [M, M].
        values: inverse eigenvalues; 0 of combinations that are not seen [M].
    """

    vectors: Tensor
    values: Tensor

    @classmethod
    def of(cls, information: Tensor, scale: Tensor | None = None) -> _Inverse:
        """Of an information [M, M], with what scales its unknowns to a diagonal of ones [M]; None: they are scaled."""
        if scale is not None:
            information = information * scale[:, None] * scale
        values, vectors = torch.linalg.eigh(information)
        inverse = torch.where(values > _UNSEEN, 1 / values.clamp(min=_UNSEEN), 0.0)
        return cls(vectors if scale is None else scale[:, None] * vectors, inverse)

    def __call__(self, columns: Tensor) -> Tensor:
        """The inverse times columns [M] or [M, k]."""
        return (self.vectors * self.values) @ (self.vectors.T @ columns)


def _scale(information: Tensor) -> Tensor:
    """What unknowns are divided by so that the diagonal of an information is one; 0 of those that are not seen."""
    diagonal = information.diagonal()
    return torch.where(diagonal > 0, diagonal.clamp(min=1e-300).rsqrt(), 0.0)


@single_threaded_torch()
def score_sums(solution: Solution, problem: Problem, batch: Batch) -> ScoreSums:
    """The sums over a batch at a solution.

    Args:
        solution: of the fit.
        problem: the solution's, with further families at the end.
        batch: samples, those of an image in one run; those of all images at some pixels.
    """
    size = solution.problem.size
    unknowns = torch.cat([solution.unknowns, problem.anywhere[size:]])
    tangent = CalibratedModel(problem, unknowns).tangent(batch)
    extra = _further(tangent.points, batch)
    squares = Tile(batch).about(tangent.radiance, solution.residual_scale)
    weight, residual = squares.weight.T.contiguous(), (squares.response - tangent.radiance).T.contiguous()
    channels, total = len(weight), problem.size + sum(len(columns) for columns in extra.values()) * len(weight)
    information, scores = torch.zeros(total, total, dtype=torch.float64), torch.zeros(total, dtype=torch.float64)
    columns = torch.cat([*extra.values()], dim=0)
    images = [*_runs(problem, batch)]
    for rows, own in images:
        for channel in range(channels):
            jacobian = torch.cat([tangent.jacobian[channel][:, rows], columns[:, rows, channel]])
            weighted = jacobian * weight[channel, rows]
            # A lobe has an amplitude per channel.
            places = torch.cat([own, problem.size + channel + channels * torch.arange(len(columns))])
            information.index_put_((places[:, None], places[None]), (weighted @ jacobian.T).double(), accumulate=True)
            scores.index_put_((places,), (weighted @ residual[channel, rows]).double(), accumulate=True)
    precision = solution.problem.prior_terms(solution.unknowns)
    if precision is not None:
        information[:size, :size] += precision.precision
        scores[:size] += precision.pull
    held = at_bound(solution.problem, solution.unknowns, solution.statistics.gradient)
    families = [problem.family(block.name) for block in problem.nuisances[len(solution.problem.nuisances) :]]
    return ScoreSums(
        information=information,
        scores=scores,
        fitted=(~held).nonzero()[:, 0],
        alone=_alone([own[own >= size] for _, own in images], total),
        places={
            **{family.name: problem.where[family.name] for family in families if not family.of_pixels},
            **_places_of(extra, problem.size, channels),
        },
        by_pixel={
            family.name: _by_pixel(tangent, weight, residual, _own(problem, family.name), batch)
            for family in families
            if family.of_pixels
        },
        units={**{family.name: family.assumed * family.spread for family in families}, **dict.fromkeys(extra, 0.1)},
        cost=float((weight * residual.square()).sum(dtype=torch.float64)),
        values=int((weight > 0).sum()),
    )


def _runs(problem: Problem, batch: Batch) -> Iterator[tuple[slice, Tensor]]:
    """The samples of each image, and the positions of the unknowns that they touch [Q]."""
    groups = problem.groups.group_of(batch)
    image = problem.groups.image_of(batch)
    _, counts = image.unique_consecutive(return_counts=True)
    ends = counts.cumsum(0)
    for start, end in zip((ends - counts).tolist(), ends.tolist(), strict=True):
        yield slice(start, end), problem.places[groups[start]]


def _alone(touched: Sequence[Tensor], total: int) -> list[Tensor]:
    """Of the unknowns that each image touches those that no other does."""
    images = torch.zeros(total, dtype=torch.long)
    for own in touched:
        images[own] += 1
    return [own[images[own] == 1] for own in touched]


@torch.no_grad()
def _further(points: Points, batch: Batch) -> dict[str, Tensor]:
    """Radiance of lobes and bodies of unit strength at the points of a batch, by family [k, n, C]."""
    one = torch.ones((), dtype=torch.float64)
    lobes = [
        CookTorrance(distribution=distribution).replace(
            {"diffuse": 0 * one, "specular": one, "slope": slope * one, "f0": 0.5 * one}
        )
        for distribution, slopes in (("beckmann", _SLOPES), ("ggx", _TAILED_SLOPES))
        for slope in slopes
    ]
    bodies = [OrenNayar().replace({"albedo": one, "sigma": roughness * one}) for roughness in _ROUGHNESSES]

    def columns(shapes: Sequence[Brdf]) -> Tensor:
        shaded = [shade(shape.to(batch.radiance.dtype, batch.radiance.device), points) for shape in shapes]
        return torch.stack([radiance.expand_as(batch.radiance) for radiance in shaded])

    return {LOBE: columns(lobes), BODY: columns(bodies)}


def _places_of(extra: Mapping[str, Tensor], start: int, channels: int) -> dict[str, slice]:
    """Where the amplitudes of further lobes and bodies stand, by family."""
    places = {}
    for name, columns in extra.items():
        places[name] = slice(start, start + len(columns) * channels)
        start += len(columns) * channels
    return places


def _own(problem: Problem, name: str) -> list[int]:
    """The rows of a Jacobian that belong to a family."""
    place, touched = problem.where[name], problem.places[0].tolist()
    return [row for row, position in enumerate(touched) if place.start <= position < place.stop]


def _by_pixel(tangent: Tangent, weight: Tensor, residual: Tensor, rows: list[int], batch: Batch) -> PixelSums:
    """Sums of a family of single pixels, of which all samples of a batch are at one of P pixels."""
    assert batch.pixels is not None
    _, pixel = batch.pixels.unique(return_inverse=True)
    columns = tangent.jacobian[:, rows]
    weighted = columns * weight[:, None]
    products = torch.einsum("ckn,cln->nkl", weighted, columns).double()
    scores = torch.einsum("ckn,cn->nk", weighted, residual).double()
    count = int(pixel.max()) + 1
    return PixelSums(
        products.new_zeros(count, *products.shape[1:]).index_add_(0, pixel, products),
        scores.new_zeros(count, scores.shape[1]).index_add_(0, pixel, scores),
    )
