"""What photographs will tell of texels that all have the same values: what a fit decides, without noise and a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from matest.estimators.columns import Columns
from matest.estimators.texels.elimination import Elimination
from matest.estimators.texels.fit import TexelFitter, TileFit, Trials
from matest.estimators.texels.models import radiance, texel_model
from matest.estimators.texels.problem import TexelPrior, TexelProblem
from matest.estimators.texels.regions import UNKNOWN_SPREAD, Regions
from matest.estimators.texels.sharing import shared
from matest.estimators.texels.small_systems import Factored
from matest.estimators.texels.some import Knowledge
from matest.estimators.texels.sums import TexelGram
from matest.estimators.texels.trust import Reliable, ScoreBias, ambiguous
from matest.estimators.texels.unknowns import TexelUnknowns
from matest.samples.residual_scale import NOISE_ALONE
from matest.samples.texels import TexelTile

# Share of the information on an unknown in common that is left once texels have followed it, below which it is
# rounding: texels then follow whatever it does.
_ROUNDING = 1e-9


class Told(NamedTuple):
    """What samples tell of n texels.

    Attributes:
        own: whether the samples of a texel tell its unknowns, as a fit decides [T, n].
        variance: of these where the unknowns in common stand still; of a shape that is not told by the texel's own
            samples, of anything else with the shapes known that are shared [T, n].
        moves: how far they follow the unknowns in common [T, S, n].
        counted: texels that tell of the unknowns in common [n]; None: all.
        seen: whether any sample shows a texel [n].
    """

    own: Tensor
    variance: Tensor
    moves: Tensor
    counted: Tensor | None
    seen: Tensor


@dataclass(frozen=True, eq=False)
class ExpectedTexels:
    """Texels of the same values u [P], and what samples without noise will tell of them.

    Attributes:
        texels: the unknowns.
        unknowns: u [P].
        tile: samples of n texels in I images; their radiance is that of u.
        informations: JᵀWJ of each image, the T unknowns of texels first, those in common after them [I, R, R, n].
    """

    texels: TexelUnknowns
    unknowns: Tensor
    tile: TexelTile
    informations: Tensor

    @classmethod
    @torch.no_grad()
    def of(cls, texels: TexelUnknowns, unknowns: Tensor, tile: TexelTile) -> ExpectedTexels:
        """At values u [P], whatever the samples of a tile have measured."""
        rows = [*texels.rows, *texels.common]
        model, theta = texel_model(texels, unknowns), texels.spread(unknowns, len(tile)).to(tile.radiance)
        columns, at = model.columns(tile, theta), model.coefficients(theta, {row.name for row in rows})
        tile = tile.measuring(radiance(columns, at, tile.images))
        squares = tile.about(tile.radiance)
        parts = []
        for image in torch.arange(len(tile.radiance)).split(len(tile)):
            of_image = Columns(columns.values[..., image], columns.tint)
            parts.append(TexelGram.of(of_image, squares.some(image), at.total, 1).normal(at, rows).information)
        return cls(texels, unknowns, tile, torch.stack(parts))

    @torch.no_grad()
    def told(self, images: Sequence[int]) -> Told:
        """What some of the images tell, by the rules of `fit_maps`."""
        texels, tile = self.texels, self.tile.of_images(images)
        fitter = _AtSolution(texels, self.unknowns, NOISE_ALONE)
        fit = fitter.expected(tile)
        first = Elimination.of(fitter, fit)
        alone = first.variance
        std, limit = alone.sqrt(), 0.0
        if fit.trials is not None:
            limit = Reliable.of(fitter, fit, first, 1.0).limit
            std = torch.where(ambiguous(fit, std, 1.0), torch.inf, std)
        values = self.unknowns[texels.places, None]
        labels = torch.zeros(len(tile), dtype=torch.int64)
        # How far values will scatter is not known before: as much as is taken where hardly a texel tells.
        told = (std < UNKNOWN_SPREAD * values.abs()).double().mean(1, keepdim=True)
        error = (1 - told).sqrt() * UNKNOWN_SPREAD * values.abs()
        regions = Regions.single(texels, self.unknowns).filled(labels, fit.theta, std, values, error)
        known = Knowledge(regions, 1.0, limit, ScoreBias.none(len(texels.common)))
        fit, own, counted, elimination, *_ = shared(fitter, fit, known)
        is_shape = texels.is_shape[:, None]
        # Of anything but a shape: with the shapes known that are shared, but nothing known of itself.
        beside = replace(fit, prior=regions.prior(labels, own | ~is_shape, 1.0))
        variance = torch.where(is_shape, alone, Elimination.of(fitter, beside).variance)
        seen = tile.usable.unflatten(0, (len(images), -1)).any(0)
        return Told(own & seen, variance, elimination.moves, counted, seen)

    def in_common(self, images: Sequence[int], names: Sequence[str], counted: Tensor | None = None) -> Tensor:
        """Information of some images on all unknowns that are not of texels, the texels following them [S, S].

        Args:
            images: by their places.
            names: of the parameters that each texel has values of its own of.
            counted: texels that tell of the others [n]; None: all.
        """
        rows = [*self.texels.rows, *self.texels.common]
        inside = torch.tensor([row.name in names for row in rows])
        # In the order of u.
        common = sorted((~inside).nonzero()[:, 0].tolist(), key=lambda k: rows[k].place)
        total = self.informations[list(images)].sum(0)
        total = total if counted is None else total * counted
        own, cross = total[inside][:, inside], total[inside][:, common]
        every = total[common][:, common]
        plain = every.sum(-1)
        if len(own):
            every = every - torch.einsum("tsn,tun->sun", cross, Factored.of(own).solve(cross))
        left = every.sum(-1)
        told = left.diagonal() > _ROUNDING * plain.diagonal()
        return torch.where(told[:, None] & told, left, 0.0)


class _AtSolution(TexelFitter):
    """A fitter of samples whose solution is known: every texel has the values that others may lend it."""

    def expected(self, tile: TexelTile) -> TileFit:
        """The solution, and what else would describe the samples nearly as well."""
        theta = self.texels.spread(self.unknowns, len(tile)).to(tile.radiance)
        prior = Regions.single(self.texels, self.unknowns).weak_prior(len(tile))
        columns = self._model.columns(tile, theta) if self._keeps_columns else None
        first = TexelProblem(tile, self._model, tile.about(tile.radiance), columns)
        problem = TexelProblem.of(first, first.squares, theta)
        if not self.texels.shapes:
            return TileFit(problem, theta, prior)
        nodes = self._tried(problem, theta)
        return TileFit(problem, theta, prior, Trials(nodes.theta, nodes.cost - problem.normal(theta, ()).cost))

    def with_prior(self, start: TileFit, prior: TexelPrior, places: Tensor) -> TileFit:  # noqa: ARG002
        """The same with another prior: its mean is the solution."""
        return replace(start, prior=prior)
