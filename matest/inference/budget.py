"""What stated errors of the calibration, which the fit did not refine, add to the error bars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from matest.estimators import Problem, accumulate
from matest.estimators.calibrated import CalibratedModel
from matest.estimators.covariance import fisher
from matest.samples import Batch, Groups, Tile
from matest.samples.account import CalibratedSamples
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.samples.tiles import in_memory

# Samples that are enough to say to some per cent how far an estimate moves.
SAMPLES = 30_000
# Samples for each pixel whose samples in all images are read: these say the same of errors of single pixels.
_SAMPLES_PER_PIXEL = 7.5


@dataclass(frozen=True, eq=False)
class Budget:
    """The estimate moves with errors of the calibration, to first order.

    A fit of weight W to samples that err by N ν moves by A⁻¹ JᵀW N ν, where A = JᵀWJ.

    Attributes:
        information: A, with the precision of priors [P, P].
        scatters: covariance of JᵀWNν under the errors of each family, by name [P, P].
    """

    information: Tensor
    scatters: Mapping[str, Tensor]

    def covariances(self, free: Tensor) -> dict[str, Tensor]:
        """The covariance [P, P] that each family adds, where some unknowns [P] are free to move."""
        inverse = fisher(self.information, free).matrix
        return {name: inverse @ scatter @ inverse for name, scatter in self.scatters.items()}


def budget(
    estimated: Tensor,
    problem: Problem,
    spreads: Mapping[str, float],
    samples: CalibratedSamples,
    seed: int,
    residual_scale: ResidualScale = NOISE_ALONE,
    count: int = SAMPLES,
) -> Budget:
    """How an estimate moves with errors of the calibration, from a random part of its samples.

    Args:
        estimated: values of the unknowns that are estimated [P].
        problem: of these unknowns, with further families at the end.
        spreads: standard deviation of the errors of these families as a whole.
        samples: that were fitted, or will be.
        seed: of the random draw.
        residual_scale: by which outliers are judged.
        count: of samples in that part.
    """
    size = len(estimated)
    unknowns = torch.cat([estimated, problem.anywhere[size:]])
    batch = by_image(next(iter(samples.batches(count, shuffle=True, seed=seed))), samples.groups)
    factor = len(samples) / len(batch)
    statistics = accumulate(problem, unknowns, in_memory([batch]), unknowns, residual_scale)
    sums = factor * replace(statistics, prior=None).information
    scatters = {}
    for name, spread in spreads.items():
        family = problem.family(name)
        if family.of_pixels:
            pixels = samples.of_pixels(round(count / _SAMPLES_PER_PIXEL), seed)
            scatter = _scatter_by_pixel(problem, name, spread, unknowns, pixels, residual_scale)
            scatters[name] = scatter[:size, :size]
        else:
            cross = spread * family.spread * sums[:size, problem.where[name]]
            scatters[name] = cross @ cross.T
    prior = problem.prior_terms(unknowns)
    information = sums if prior is None else sums + prior.precision
    return Budget(information[:size, :size], scatters)


def by_image(batch: Batch, groups: Groups) -> Batch:
    """The samples with one group an image: only sums over all of them are wanted, and pixels at random mix blocks."""
    first = torch.full((groups.images,), len(groups.image)).scatter_reduce(
        0, groups.image, torch.arange(len(groups.image)), "amin"
    )
    return replace(batch, groups=first[groups.image_of(batch)])


def _scatter_by_pixel(
    problem: Problem,
    name: str,
    spread: float,
    unknowns: Tensor,
    samples: tuple[Batch, float],
    residual_scale: ResidualScale,
) -> Tensor:
    """Mean square [Q, Q] by all unknowns of JᵀWNν where each pixel of the object has errors ν of its own.

    They are the same in all images: scores are added up pixel by pixel before they are squared. To second order errors
    that are 0 on average still change the mean radiance, as a rougher surface would. `samples` are those of
    `CalibratedSamples.of_pixels`.
    """
    size, errors = problem.size, problem.where[name]
    batch, factor = samples
    assert batch.pixels is not None
    tangent = CalibratedModel(problem, unknowns).tangent(batch)
    weight = Tile(batch).about(tangent.radiance, residual_scale).weight.T[:, None]
    places = problem.places[problem.groups.group_of(batch)]
    _, pixel = batch.pixels.unique(return_inverse=True)

    def scores(change: Tensor) -> Tensor:
        """JᵀW times a change of the radiance [C, n], pixel by pixel [m, Q]."""
        by_sample = (tangent.jacobian * weight * change[:, None]).sum(0).double().T
        out = torch.zeros(int(pixel.max()) + 1, size, dtype=torch.float64)
        return out.index_put_((pixel[:, None].expand_as(places), places), by_sample, accumulate=True)

    own = ((places[0] >= errors.start) & (places[0] < errors.stop)).nonzero()[:, 0]
    total = torch.zeros(size, size, dtype=torch.float64)
    bend = torch.zeros_like(tangent.radiance)
    for column, position in zip(own.tolist(), range(errors.start, errors.stop), strict=True):
        by_pixel = spread * scores(tangent.jacobian[:, column])
        total += factor * by_pixel.T @ by_pixel
        for sign in (1, -1):
            moved = unknowns.clone()
            moved[position] += sign * spread
            bend += (CalibratedModel(problem, moved).radiance(batch) - tangent.radiance) / 2
    mean = factor * scores(bend.T).sum(0)
    return total + mean[:, None] * mean
