"""Fits of small simulated captures, and samples made by hand, for tests of what is inferred from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.capture import Capture
from matest.estimation.options import Options, Value
from matest.estimation.specification import specify
from matest.estimators import Solution, Statistics, fit
from matest.estimators.moments import scores
from matest.inference.posterior import Posterior, judge
from matest.samples import Groups, Samples
from tests.problems import problem


@dataclass(frozen=True)
class Judged:
    """A fit and what is inferred from it."""

    solution: Solution
    samples: Samples
    posterior: Posterior

    def positions(self, *names: str) -> set[int]:
        """Positions of parameters among the unknowns."""
        where = self.solution.problem.where
        return {position for name in names for position in range(where[name].start, where[name].stop)}


def judged(
    capture: Capture,
    expression: str,
    *,
    fix: Mapping[str, Value] | None = None,
    free: tuple[str, ...] = (),
    tie: Mapping[str, str] | None = None,
) -> Judged:
    """Fit and judge without any of what `estimate` does beside."""
    specification = specify(
        expression,
        Options(fix=fix or {}, free=free, tie=tie or {}),
        channels=capture.channels,
        relative=capture.relative,
        scene=capture.scene,
    )
    samples = capture.samples(range(len(capture)))
    solution = fit(specification.problem, samples, 0)
    return Judged(solution, samples, judge(solution, samples))


@dataclass(frozen=True)
class Source:
    """All of samples that error bars ask for."""

    noise_stated: bool
    groups: Groups


def source(images: int, blocks: int = 1, *, noise_stated: bool = True) -> Source:
    """Samples of some images with so many blocks each."""
    return Source(noise_stated, Groups(torch.arange(images).repeat_interleave(blocks)))


def solved(
    gradients: Tensor, *, chi2: float = 1.0, values: int = 100_000, at: tuple[float, float] = (0.5, 0.3)
) -> Solution:
    """Oren-Nayar's albedo and sigma with an information of 100 and 25 in every group.

    Args:
        gradients: of every group [G, 2].
        chi2: per value.
        values: of all groups together.
        at: albedo and sigma.
    """
    groups = len(gradients)
    informations = torch.diag(torch.tensor([100.0, 25.0], dtype=torch.float64)).expand(groups, 2, 2)
    share = values / groups
    row = scores(cost=chi2 * share, chi2=chi2 * share, values=share, samples=share, squared_signal=1.0)
    statistics = Statistics(torch.arange(groups), informations, gradients.double(), row.expand(groups, -1))
    unknowns = torch.tensor(at, dtype=torch.float64)
    return Solution(problem("oren-nayar"), unknowns, statistics, 1, 0.0, True)
