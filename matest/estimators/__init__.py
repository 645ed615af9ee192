"""Solvers: from samples to the parameters of a uniform material."""

from matest.estimators.fit import AllTiles, fit, fit_batches
from matest.estimators.levenberg_marquardt import Solution, at_bound, bounded_step
from matest.estimators.linearise import Linearisation, accumulate
from matest.estimators.moments import Statistics
from matest.estimators.unknowns import Problem

__all__ = [
    "AllTiles",
    "Linearisation",
    "Problem",
    "Solution",
    "Statistics",
    "accumulate",
    "at_bound",
    "bounded_step",
    "fit",
    "fit_batches",
]
