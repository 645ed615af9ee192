"""Error bars: Fisher information, errors clustered by image, intervals, and what is not determined."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.statistics import Statistics

# Eigenvalue of the scaled information. The data do not determine a direction with a smaller one: shading in single
# precision gives such a direction 1e-7 by rounding.
_NULL_EIGENVALUE = 2e-7
# Eigenvalue of the scaled information. The data hardly determine a direction with a smaller one: it makes standard
# errors thirty times those of uncorrelated parameters.
_WEAK_EIGENVALUE = 1e-3
# Component of a unit vector. A parameter takes part in a direction if its component is larger; smaller ones are mostly
# rounding and the weak correlation of all parameters.
PARTICIPATES = 0.1
# Share of the largest diagonal element of the information. A smaller element is rounding.
_ROUNDING_INFORMATION = 1e-30
# Share of the information on an unknown that other clusters than its own may have by rounding.
_ALONE = 1e-9
# Smallest number whose inverse root is finite in double precision, with a margin.
_TINY = 1e-300


@dataclass(frozen=True)
class Covariance:
    """Covariance of an estimate.

    Attributes:
        matrix: [P, P]; rows of parameters at a bound or not determined are zero.
        undetermined: True for parameters that appear only in combinations the data cannot tell apart [P].
        degrees: of freedom behind the standard errors (infinite: known noise).
    """

    matrix: Tensor
    undetermined: Tensor
    degrees: float = math.inf

    @property
    def std(self) -> Tensor:
        return self.matrix.diagonal().clamp(min=0).sqrt()

    @property
    def correlation(self) -> Tensor:
        std = self.std
        scale = torch.where(std > 0, std, torch.ones_like(std))
        return self.matrix / scale[:, None] / scale[None, :]


def fisher(information: Tensor, free: Tensor) -> Covariance:
    """Inverse of the Fisher information JᵀWJ over the parameters that are free (not at a bound) [P]."""
    undetermined = torch.zeros(len(information), dtype=torch.bool)
    inverse = torch.zeros_like(information)
    index = free.nonzero()[:, 0]
    if len(index):
        inside = information[index][:, index]
        scale, informed = _units(inside)
        values, vectors, null = _spectrum(inside, scale)
        undetermined[index] = (vectors[:, null].abs() > PARTICIPATES).any(1) | ~informed
        root = vectors[:, ~null] / values[~null].sqrt()
        inverse[index[:, None], index[None, :]] = (root @ root.T) * scale[:, None] * scale[None, :]
        inverse[undetermined] = 0
        inverse[:, undetermined] = 0
    return Covariance(inverse, undetermined)


def _units(information: Tensor) -> tuple[Tensor, Tensor]:
    """1/√ of the diagonal [P], and for which unknowns the data hold any information [P].

    The first is 0 for unknowns without: their rows may be filled by rounding alone.
    """
    diagonal = information.diagonal()
    informed = diagonal > _ROUNDING_INFORMATION * diagonal.abs().max()
    return torch.where(informed, diagonal.clamp(min=_TINY).rsqrt(), 0.0), informed


def _spectrum(information: Tensor, scale: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Eigenvalues and vectors of the scaled information, and which of them the data do not determine."""
    values, vectors = torch.linalg.eigh(information * scale[:, None] * scale[None, :])
    return values, vectors, values < _NULL_EIGENVALUE


def weak_directions(information: Tensor) -> Iterator[Tensor]:
    """Directions that the data hardly determine: of each the absolute components, 0 to 1, by unknown [P].

    Args:
        information: JᵀWJ [P, P].
    """
    scale, _ = _units(information)
    values, vectors, null = _spectrum(information, scale)
    for k in (~null & (values < _WEAK_EIGENVALUE)).nonzero()[:, 0].tolist():
        yield vectors[:, k].abs()


def error_of(information: Tensor, direction: Tensor) -> float | None:
    """Standard error of the combination `direction` · u, with JᵀWJ `information`; None if it is not determined.

    A combination may be well determined though none of its unknowns is.
    """
    scale, _ = _units(information)
    values, vectors, null = _spectrum(information, scale)
    # In units of the scaled unknowns; an unknown without information has no scale, and keeps its own unit.
    components = vectors.T @ torch.where(scale > 0, direction * scale, direction)
    if float(components[null].norm()) > PARTICIPATES * float(components.norm()):
        return None
    return float((components[~null].square() / values[~null]).sum()) ** 0.5


def jackknife(
    clusters: Statistics,
    free: Tensor,
    resolve: Callable[[Tensor, Tensor], Tensor],
) -> Covariance:
    """Covariance from leaving out one cluster of correlated samples at a time.

    Args:
        clusters: of correlated samples, at the solution, where gradients add up to (almost) zero.
        free: parameters not at a bound [P].
        resolve: gives the change of the parameters, inside their bounds, for a JᵀWJ and a JᵀWr.
    """
    information, gradient = clusters.information, clusters.gradient
    by_samples, has_prior = information.diagonal(), torch.zeros(len(information), dtype=torch.bool)
    if clusters.prior is not None:
        precision = clusters.prior.precision.diagonal()
        by_samples, has_prior = by_samples - precision, precision > 0
    reference = fisher(information, free)
    changes = torch.zeros(len(clusters), len(information), dtype=torch.float64)
    for position in range(len(clusters)):
        cluster = clusters.only(position)
        rest, pull = information - cluster.information, gradient - cluster.gradient
        # Unknowns of this cluster alone, such as errors of its light, stay: only the prior would be left of them.
        alone = has_prior & (cluster.information.diagonal() > (1 - _ALONE) * by_samples)
        rest[alone] = 0.0
        rest[:, alone] = 0.0
        rest[alone, alone] = 1.0
        changes[position] = resolve(rest, torch.where(alone, 0.0, pull))
    changes = changes - changes.mean(0)
    count = len(changes)
    matrix = (count - 1) / count * changes.T @ changes
    without_error = reference.undetermined | ~free
    matrix[without_error] = 0
    matrix[:, without_error] = 0
    return Covariance(matrix, reference.undetermined, degrees=count - 1)


def correlation_of_residuals(groups: Statistics, covariance: Covariance) -> tuple[float, float]:
    """How much more the scores JᵀWr of clusters scatter than those of independent residuals: 1 if the model holds.

    It is Σ gᵀ A⁻¹ g over the clusters, divided by the number of parameters; A is the information. Residuals may be as
    small as the noise and yet have one sign over whole regions, which moves estimates far more than noise does (the
    idea of White's information matrix test, 1982).

    Args:
        groups: of samples, at the solution.
        covariance: A⁻¹ over the free parameters, the noise as large as the residuals.

    Returns:
        The ratio, and its standard deviation where residuals are independent.
    """
    rank = max(int((covariance.matrix.diagonal() > 0).sum()), 1)
    matrix, gradients = covariance.matrix.expand(len(groups), -1, -1), groups.gradients / groups.inflation
    if groups.places is not None:
        matrix = covariance.matrix[groups.places[:, :, None], groups.places[:, None, :]]
    shares = groups.informations / groups.inflation @ matrix
    chance_std = math.sqrt(2 * float((shares * shares.mT).sum()))
    scatter = float((gradients[:, None] @ matrix @ gradients[..., None]).sum())
    return scatter / rank, chance_std / rank


def quantile95(degrees: float) -> float:
    """Half-width of a 95 % interval in standard errors."""
    if math.isinf(degrees):
        return 1.959963984540054
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 0.975))
