"""Solvers: from samples to the unknowns of a uniform material."""

from matest.estimators.fit import fit, fit_some
from matest.estimators.levenberg_marquardt import Solution, at_bound, bounded_step
from matest.estimators.passes import accumulate
from matest.estimators.pilot import fit_batches
from matest.estimators.statistics import Statistics
from matest.estimators.unknowns import Problem

__all__ = [
    "Problem", "Solution", "Statistics", "accumulate", "at_bound", "bounded_step", "fit", "fit_batches", "fit_some",
]  # fmt: skip
