"""A model together with errors of the calibration: radiance, and its derivatives by both, from the same shader."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from matest.brdf import Brdf, Sum
from matest.estimators.basis import TangentBasis
from matest.estimators.columns import Columns
from matest.estimators.moments import SCORES, runs, score_sums, sum_by_label
from matest.estimators.statistics import Statistics
from matest.estimators.tile_sums import Expanded, over_tiles
from matest.estimators.unknowns import Problem
from matest.parameters import Role
from matest.samples import Batch, Tile, Tiles
from matest.samples.calibration import Displaced
from matest.samples.likelihood import LeastSquares
from matest.samples.residual_scale import ResidualScale
from matest.scene import Points
from matest.shading import shade


@dataclass(frozen=True, eq=False)
class Tangent:
    """A model to first order at n samples.

    Attributes:
        radiance: [n, C].
        jacobian: its derivatives by the Q unknowns that the group of each sample touches [C, Q, n].
        points: geometry and light under the errors.
    """

    radiance: Tensor
    jacobian: Tensor
    points: Points


class CalibratedModel:
    """The radiance of a problem with errors of the calibration, at some unknowns u [P]."""

    def __init__(self, problem: Problem, unknowns: Tensor, material: Brdf | None = None) -> None:
        """See the class; `material` has values at every sample [n, 1 or C] in place of those of the unknowns."""
        assert problem.calibration is not None
        self._problem = problem
        self._calibration = problem.calibration
        self._unknowns = unknowns
        self._errors = unknowns[problem.nuisance_places]
        self._material = problem.material(unknowns) if material is None else material
        self._basis = TangentBasis(problem, unknowns)
        self._body = body_albedos(problem.brdf)

    def radiance(self, batch: Batch) -> Tensor:
        """Of samples [n, C]."""
        with torch.no_grad():
            displaced = self._calibration.displaced(batch, self._values(batch))
            return displaced.decoded(self._blurred(displaced, batch))

    def tangent(self, batch: Batch) -> Tangent:
        """Radiance and derivatives; the latter are those without blur, except by the blur itself."""
        displaced, true, radiance, by_errors = self._to_first_order(batch)
        with torch.no_grad():
            # The sky of an error of size 0 is there to be differentiated by the error, which is done.
            displaced = replace(displaced, points=displaced.points.without_black_sky())
            by_material = self._by_material(displaced, batch) * displaced.slope(true).T[:, None]
            jacobian = torch.cat([by_material, by_errors], dim=1)
            return Tangent(radiance.detach(), jacobian, displaced.points)

    def by_errors(self, batch: Batch) -> Tensor:
        """Derivatives of the radiance by the q errors that the group of each sample is under [C, q, n]."""
        return self._to_first_order(batch)[3]

    def _to_first_order(self, batch: Batch) -> tuple[Displaced, Tensor, Tensor, Tensor]:
        """Samples under the errors, their true and their decoded radiance, and its derivatives by the errors."""
        values = self._values(batch).requires_grad_()
        with torch.enable_grad():
            displaced = self._calibration.displaced(batch, values)
            true = self._blurred(displaced, batch)
            radiance = displaced.decoded(true)
            by_channel = [
                torch.autograd.grad(radiance[:, channel].sum(), values, retain_graph=True)[0].T
                for channel in range(radiance.shape[1])
            ]
        return displaced, true, radiance, torch.stack(by_channel)

    def _values(self, batch: Batch) -> Tensor:
        """The errors that each sample is under [n, q]."""
        return self._errors[self._problem.groups.group_of(batch)].to(batch.radiance)

    def _blurred(self, displaced: Displaced, batch: Batch) -> Tensor:
        """Radiance [n, C] before it is decoded."""
        radiance = self._shaded(displaced, batch)
        weights, around = displaced.weights, displaced.around
        if weights is None or around is None:
            return radiance
        with torch.no_grad():
            beside = self._shaded(around, batch).unflatten(0, (-1, len(batch)))
            here = radiance.detach()
        blurred = weights[0][:, None] * here + (weights[1:, :, None] * beside).sum(0)
        return radiance + (blurred - here)

    def _shaded(self, displaced: Displaced, batch: Batch) -> Tensor:
        """Radiance [n, C] without blur."""
        material = self._material.to(batch.radiance.dtype, batch.radiance.device)
        if displaced.body is not None:
            values = material.parameters
            material = material.replace({name: values[name] * displaced.body for name in self._body})
        return shade(material, displaced.points).expand(-1, batch.radiance.shape[1])

    def _by_material(self, displaced: Displaced, batch: Batch) -> Tensor:
        """Derivatives [C, Q, n] by the unknowns of the material, before the radiance is decoded."""
        basis = self._basis
        columns = basis.columns(Tile(replace(batch, points=displaced.points)))
        if displaced.body is not None:
            powers = [sum(factor.name in self._body for factor in factors) for factors in basis.column_factors]
            scale = torch.stack([displaced.body[:, 0] ** power for power in powers])
            columns = Columns(columns.values * scale, columns.tint)
        return columns.sums((basis.slopes @ self._problem.selectors).mT).permute(2, 0, 1)


def body_albedos(brdf: Brdf) -> frozenset[str]:
    """Parameters that are the albedo of a diffuse body: those of diffuse models, and of diffuse parts of others."""
    names = set()
    components = {f"{part.name}.": part for part in brdf.components} if isinstance(brdf, Sum) else {"": brdf}
    for prefix, part in components.items():
        for name, declared in part.declared.items():
            is_albedo = declared.per_channel and name in part.structure.amplitudes
            if declared.role is Role.BODY or (part.body and is_albedo):
                names.add(prefix + name)
    return frozenset(names)


def accumulate_calibrated(
    problem: Problem, unknowns: Tensor, tiles: Tiles, reference: Tensor | None, residual_scale: ResidualScale
) -> Statistics:
    """One pass: the additive statistics at `unknowns` of a problem with errors of the calibration.

    Arguments are those of `accumulate`.
    """
    here = CalibratedModel(problem, unknowns)
    there = None if reference is None or torch.equal(reference, unknowns) else CalibratedModel(problem, reference)

    def expand(tile: Tile) -> Expanded[Statistics]:
        tangent = here.tangent(tile.batch)
        about = None
        if reference is not None and tile.least_squares is None:
            about = tangent.radiance if there is None else there.radiance(tile.batch)
        return Expanded(about, lambda tile, squares: _tangent_sums(tangent, squares, tile.batch))

    parts = over_tiles(tiles, expand, residual_scale)
    width = problem.places.shape[1]
    empty = torch.zeros(0, width, width, dtype=torch.float64)
    labels, informations, gradients, scores = sum_by_label(
        torch.cat([torch.zeros(0).long(), *(part.labels for part in parts)]),
        torch.cat([empty, *(part.informations for part in parts)]),
        torch.cat([empty[..., 0], *(part.gradients for part in parts)]),
        torch.cat([torch.zeros(0, len(SCORES), dtype=torch.float64), *(part.scores for part in parts)]),
    )
    return Statistics(
        labels=labels,
        informations=informations,
        gradients=gradients,
        scores=scores,
        places=problem.places[labels],
        prior=problem.prior_terms(unknowns),
        unknowns=problem.size,
    )


def _tangent_sums(tangent: Tangent, squares: LeastSquares, batch: Batch) -> Statistics:
    """The statistics of the groups of a tile."""
    weight, residual = squares.weight.T.contiguous(), (squares.response - tangent.radiance).T.contiguous()
    jacobian = tangent.jacobian
    weighted = jacobian * weight[:, None]
    labels, parts = runs(batch.groups, len(batch))
    informations = [(weighted[..., part] @ jacobian[..., part].mT).sum(0, dtype=torch.float64) for part in parts]
    gradients = [(weighted[..., part] @ residual[:, part, None]).sum(0, dtype=torch.float64)[:, 0] for part in parts]
    scores = score_sums(squares, weight, residual, parts)
    return Statistics(labels, torch.stack(informations).cpu(), torch.stack(gradients).cpu(), scores)
