"""Which family of errors explains what a fit leaves: each is judged by its evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.inference.score_sums import ScoreSums, Spectrum

# Spreads that are tried, in units of the one that is usual for a family, evenly in their logarithm.
_LEAST_SPREAD, _LARGEST_SPREAD, _SPREADS = 1e-3, 10.0, 41
# Logarithm of the ratio of the probabilities of the residuals with a family and without it that chance does not bring.
_LEAST_EVIDENCE = 8.0
# Share of the evidence of the best family from which on another one explains the residuals about as well.
_ALIKE = 0.7


@dataclass(frozen=True)
class Suspect:
    """A family of errors that would explain residuals.

    Attributes:
        name: of the family.
        evidence: logarithm of the ratio of the probabilities of the residuals with it and without it.
        spread: most probable standard deviation of each of its unknowns.
        unknowns: number of them.
        gain: χ² that it would take away.
    """

    name: str
    evidence: float
    spread: float
    unknowns: int
    gain: float

    @property
    def order(self) -> int:
        """Order of magnitude of the number of unknowns."""
        return len(str(self.unknowns))


def suspects(sums: ScoreSums) -> list[Suspect]:
    """The families that chance does not explain, the most probable first."""
    # Beside the family that is right the residuals are the noise; while it is looked for, this comes closest to that.
    inflation = max(sums.chi2_with_everything(), 1.0)
    found = [_suspect(name, sums.spectrum(name), sums.units[name], inflation) for name in sums.families]
    return sorted((one for one in found if one.evidence > _LEAST_EVIDENCE), key=lambda one: -one.evidence)


def alike(ranked: Sequence[Suspect]) -> list[Suspect]:
    """Those that explain the residuals about as well as the first.

    In front stand those whose unknowns are fewer by an order of magnitude: what a few explain, many can too.
    """
    near = [one for one in ranked if one.evidence >= _ALIKE * ranked[0].evidence]
    return sorted(near, key=lambda one: one.order)


def _suspect(name: str, spectrum: Spectrum, unit: float, inflation: float) -> Suspect:
    """A family at the spread at which it is most probable.

    The marginal likelihood of MacKay 1992 (Neural Computation 4, 415, section 2.4), the likelihood being quadratic.
    """
    exponents = torch.linspace(math.log(_LEAST_SPREAD), math.log(_LARGEST_SPREAD), _SPREADS, dtype=torch.float64)
    spreads = unit * exponents.exp()
    evidence = _evidence(spectrum, spreads, inflation)
    best = int(evidence.argmax())
    spread = float(spreads[best])
    return Suspect(
        name, float(evidence[best]), spread, len(spectrum.information), _gain(spectrum, spread**2 / inflation)
    )


def _gain(spectrum: Spectrum, variance: float) -> float:
    """χ² that errors of this prior variance, in units of the inflation, take away at their most probable values."""
    shrunk = variance / (1 + variance * spectrum.information)
    return float((spectrum.squares * shrunk * (2 - spectrum.information * shrunk)).sum())


def _evidence(spectrum: Spectrum, spreads: Tensor, inflation: float) -> Tensor:
    """The evidence for each of some spreads [S]."""
    information = spectrum.information.clamp(min=0) / inflation
    squares = spectrum.squares / inflation**2
    variances = spreads.square()[:, None]
    return 0.5 * (squares * variances / (1 + variances * information) - (variances * information).log1p()).sum(1)
