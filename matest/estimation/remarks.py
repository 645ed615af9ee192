"""Remarks on an estimate: how the fit went, and what was not computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from matest.estimation.specification import beside_body
from matest.estimators import Solution
from matest.inference.error_bars import ErrorBars
from matest.samples.account import Account, AccountedSamples


def message(solution: Solution, bars: ErrorBars, unread: int, *, random: bool = True) -> str:
    """How the fit went, as a sentence.

    Args:
        solution: of the fit.
        bars: error bars.
        unread: number of samples that the precision did not need.
        random: whether no errors are known that would explain the residuals.
    """
    if not solution.converged:
        return (
            f"Not converged: after {solution.iterations} passes the next step would still move the estimate by "
            f"{solution.last_step:.2g} standard errors"
            + ("." if bars.holds else f", and the model does not hold to the noise ({bars.reason}).")
        )
    outcome = "Converged to the precision asked for on a subsample" if unread else "Converged"
    if solution.problem.nuisances:
        outcome += ", errors of the calibration refined"
    if bars.holds and not random:
        return (
            f"{outcome}; residuals are hardly larger than the noise (reduced χ² {bars.chi2:.2f}), but the first note "
            "explains a part of them, which error bars allow for."
        )
    if bars.holds:
        return f"{outcome}; the model describes the images to their noise (reduced χ² {bars.chi2:.2f})."
    if bars.kind == "fisher":
        return f"{outcome}; residuals are {math.sqrt(bars.chi2):.3g} times the noise, error bars scaled by that."
    return f"{outcome}; the model does not hold to the noise ({bars.reason}), so error bars come from the {bars.kind}."


def unread_samples(samples: AccountedSamples, solution: Solution) -> int:
    """How many samples the precision that the user asked for did not need."""
    return max(len(samples) - int(solution.statistics.total("samples")), 0)


def skipped(samples: AccountedSamples, solution: Solution, held_out: int, unsupported: Sequence[str]) -> dict[str, Any]:
    """What was not computed, and why; counts of pixels are over all images.

    Args:
        samples: that were fitted.
        solution: of the fit.
        held_out: number of images left out of the fit.
        unsupported: components that `auto` tried and the images do not support.
    """
    fit_pass, account = Pass(samples, solution), samples.account
    counts = {
        "redundant": fit_pass.merged,
        "unread": fit_pass.unread,
        "idle": len(account.redundancy.images) * account.pixels,
        "held_out": held_out * account.pixels,
    }
    work = [note for rule in WORK_SAVED for note in rule(fit_pass)]
    return {"components": [*unsupported], "samples": {**account.skipped, **counts}, "work": work}


@dataclass(frozen=True)
class Pass:
    """A pass over samples, as the rules on saved work read it.

    Attributes:
        samples: that were fitted.
        solution: of the fit.
    """

    samples: AccountedSamples
    solution: Solution

    @property
    def account(self) -> Account:
        return self.samples.account

    @property
    def unread(self) -> int:
        return unread_samples(self.samples, self.solution)

    @property
    def merged(self) -> int:
        """Number of samples that were merged into others."""
        statistics = self.solution.statistics
        return max(int(statistics.total("samples") - statistics.total("evaluated")), 0)


def _idle_images(fit_pass: Pass) -> Iterator[str]:
    for image, reason in fit_pass.account.redundancy.images.items():
        yield f"image {image} ({fit_pass.account.names[image]}): {reason}"


def _copied_channels(fit_pass: Pass) -> Iterator[str]:
    if copies := fit_pass.account.redundancy.channels:
        yield f"{copies} channels: they are copies of the first in every image"


def _merged_pixels(fit_pass: Pass) -> Iterator[str]:
    if fit_pass.merged:
        yield (
            f"shading of {fit_pass.merged:,} pixels: over smooth squares of 7×7 or 21×21 it is bilinear or "
            "biquadratic, four or nine samples carry what all say"
        )


def _unread_samples(fit_pass: Pass) -> Iterator[str]:
    if fit_pass.unread:
        yield f"reading {fit_pass.unread:,} samples: the others give the precision asked for"


def _light_and_shape(fit_pass: Pass) -> Iterator[str]:
    yield from fit_pass.account.geometry


def _colour(fit_pass: Pass) -> Iterator[str]:
    problem = fit_pass.solution.problem
    values = problem.values(fit_pass.solution.unknowns)
    alike = all(values[name].numel() == 1 for name in problem.shaping)
    if alike and fit_pass.account.one_light_each and problem.channels > 1:
        yield "colour: each image has one light, shapes are evaluated once for all channels"


def _second_body(fit_pass: Pass) -> Iterator[str]:
    problem = fit_pass.solution.problem
    for name in problem.held:
        if beside_body(problem.brdf, name) and float(problem.held[name]) == 0:
            yield f"{name}: another component is the diffuse one"


# In the order of the sentences.
WORK_SAVED: tuple[Callable[[Pass], Iterator[str]], ...] = (
    _idle_images,
    _copied_channels,
    _merged_pixels,
    _unread_samples,
    _light_and_shape,
    _colour,
    _second_body,
)
