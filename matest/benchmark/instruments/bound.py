"""What an estimator is asked of a subject, and how well it could be known: the Cramér-Rao bound."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from matest.benchmark.instruments.photographs import Subject
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.estimators import Problem, accumulate
from matest.estimators.covariance import Covariance, fisher


def problem_of(subject: Subject, fix: Mapping[str, Any]) -> Problem:
    """What is estimated of a subject, some parameters fixed."""
    options, scene = Options(fix=dict(fix)), subject.scene
    return specify(subject.material.expression, options, channels=scene.channels, relative=False, scene=scene).problem


def cramer_rao(problem: Problem, subject: Subject) -> Covariance:
    """The least covariance of the unknowns [P], for an observer who knows which pixels are outliers or saturated.

    Every other lit pixel off the rim counts, weighed by the noise at its true radiance.
    """
    truth = problem.unknowns_at(subject.material.parameters)
    samples = subject.ideal().samples(dtype=torch.float64)
    information = accumulate(problem, truth, samples.tiles(merge=False), truth).information
    clean = 1 - subject.sensor.conditions.outliers
    return fisher(information * clean, torch.ones(problem.size, dtype=torch.bool))
