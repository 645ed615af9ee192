"""Solvers: from samples to the parameters of a uniform material."""

from matest.estimators.fit import fit, fit_pilot
from matest.estimators.levenberg_marquardt import Solution
from matest.estimators.problem import Problem

__all__ = ["Problem", "Solution", "fit", "fit_pilot"]
