"""Error bars: Fisher information, errors clustered by image, intervals, and what is not determined."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.statistics import Statistics

# Eigenvalues of the scaled information below this belong to directions that the data do not determine: rounding of
# shading in single precision makes up 1e-7. Below the second they hardly do.
_SINGULAR, _WEAK = 2e-7, 1e-3
# A parameter takes part in such a direction if it makes up more than this of it.
PARTICIPATES = 0.1


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
        scale, told = _units(inside)
        values, vectors, lost = _spectrum(inside, scale)
        undetermined[index] = (vectors[:, lost].abs() > PARTICIPATES).any(1) | ~told
        kept = vectors[:, ~lost] / values[~lost].sqrt()
        inverse[index[:, None], index[None, :]] = (kept @ kept.T) * scale[:, None] * scale[None, :]
        lose = undetermined.nonzero()[:, 0]
        inverse[lose] = 0
        inverse[:, lose] = 0
    return Covariance(inverse, undetermined)


def _units(information: Tensor) -> tuple[Tensor, Tensor]:
    """1/√ of the diagonal [P], and of which unknowns the data say anything.

    It is 0 for the others, whose rows rounding alone may have filled.
    """
    diagonal = information.diagonal()
    told = diagonal > 1e-30 * diagonal.abs().max()
    return torch.where(told, diagonal.clamp(min=1e-300).rsqrt(), 0.0), told


def _spectrum(information: Tensor, scale: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Eigenvalues and vectors of the scaled information, and which of them the data do not determine."""
    values, vectors = torch.linalg.eigh(information * scale[:, None] * scale[None, :])
    return values, vectors, values < _SINGULAR


def weak_directions(information: Tensor) -> Iterator[Tensor]:
    """Directions that the data hardly determine: how much of each every unknown makes up, 0 to 1 [P].

    Args:
        information: JᵀWJ [P, P].
    """
    scale, _ = _units(information)
    values, vectors, lost = _spectrum(information, scale)
    for k in (~lost & (values < _WEAK)).nonzero()[:, 0].tolist():
        yield vectors[:, k].abs()


def error_of(information: Tensor, direction: Tensor) -> float | None:
    """Standard error of the combination `direction` · u of unknowns with JᵀWJ `information`; None if it is not seen.

    A combination may be well determined though none of its unknowns is.
    """
    scale, _ = _units(information)
    values, vectors, lost = _spectrum(information, scale)
    # In units of the scaled unknowns; one that nothing is known of takes part as it is.
    along = vectors.T @ torch.where(scale > 0, direction * scale, direction)
    if float(along[lost].norm()) > PARTICIPATES * float(along.norm()):
        return None
    return float((along[~lost].square() / values[~lost]).sum()) ** 0.5


def jackknife(
    clusters: Statistics,
    free: Tensor,
    resolve: Callable[[Tensor, Tensor], Tensor],
) -> Covariance:
    """Covariance from leaving out one cluster of correlated samples at a time.

    Args:
        clusters: of correlated samples, at the solution, where gradients add up to (almost) zero.
        free: parameters not at a bound [P].
        resolve: change of the parameters for given JᵀWJ and JᵀWr, inside their bounds.
    """
    total, slope = clusters.information, clusters.gradient
    reference = fisher(total, free)
    moved = torch.stack(
        [
            resolve(total - cluster.information, slope - cluster.gradient)
            for cluster in (clusters.only(position) for position in range(len(clusters)))
        ]
    )
    moved = moved - moved.mean(0)
    count = len(moved)
    matrix = (count - 1) / count * moved.T @ moved
    lose = (reference.undetermined | ~free).nonzero()[:, 0]
    matrix[lose] = 0
    matrix[:, lose] = 0
    return Covariance(matrix, reference.undetermined, degrees=count - 1)


def correlation_of_residuals(groups: Statistics, covariance: Covariance) -> tuple[float, float]:
    """How much more the scores JᵀWr of clusters scatter than independent residuals would: 1 if the model holds.

    The mean over parameters of gᵀ A⁻¹ g summed over clusters, A the information: residuals may be as small as the
    noise and yet lean the same way over whole regions, which moves estimates far more than noise does (the idea of
    White's information matrix test, 1982).

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
    by_chance = math.sqrt(2 * float((shares * shares.mT).sum()))
    scatter = float((gradients[:, None] @ matrix @ gradients[..., None]).sum())
    return scatter / rank, by_chance / rank


def quantile95(degrees: float) -> float:
    """Half-width of a 95 % interval in standard errors."""
    if math.isinf(degrees):
        return 1.959963984540054
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 0.975))
