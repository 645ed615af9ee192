"""The facade: fit a model to a measured reflectance."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from matest.errors import Fault, refuse
from matest.estimation.estimate import solve, summary
from matest.estimation.options import AUTO, Options, Value
from matest.estimation.result import Estimate
from matest.estimation.selection import Selection, select
from matest.estimation.specification import Specification, expression_of
from matest.estimation.warnings import GENERAL_RULES, Context, warnings
from matest.estimators import Problem, Solution, fit
from matest.estimators.passes import radiance_model
from matest.inference.error_bars import ErrorBars
from matest.inference.posterior import judge
from matest.progress import Progress, silent
from matest.tables.loss import Loss, cube_root
from matest.tables.noise import estimated_noise, first_noise, stated_noise
from matest.tables.samples import TableNoise, TableSamples

if TYPE_CHECKING:
    from matest.tables import Table

SCHEMA = "matest.fit/1"
# Rounds of fit and noise. Relative change of the noise that ends them: it changes error bars by less than they say.
_MAX_ROUNDS = 12
_NOISE_CHANGE = 0.01
# Relative rms difference of cube roots above which no one would take the model for the material.
_MISSED = 0.2
# The same, above which it is said where the model is wrong.
_WORTH_SAYING = 0.03
# Pairs of directions below which a table says nothing of a model.
_MIN_PAIRS = 8
# 1/sr. No measured reflectance is larger; squares of larger numbers overflow.
_LARGEST = 1e9
# Incidences that error bars from leaving out one at a time need.
_MIN_INCIDENCES = 4


@dataclass(frozen=True)
class Misfit:
    """How far a model is from some of the values, y = f cos θi.

    Attributes:
        label: what the values have in common.
        values: their number.
        relative_rmse: rms difference of y over the rms of y.
        cube_root_error: rms difference of ∛y, sr^(−1/3), every value by its solid angle.
        relative_cube_root_error: the same over the rms of ∛y.
    """

    label: str
    values: int
    relative_rmse: float
    cube_root_error: float
    relative_cube_root_error: float


@dataclass(frozen=True)
class TableFit:
    """A model fitted to a table.

    Attributes:
        estimate: parameters, error bars, warnings, as of a capture.
        samples: that were fitted: the table in the order of its incidences, the noise.
        misfit: of all values.
        incidences, channels: of the values of each.
        verdict: whether the model is the material, in a sentence; it is the first of the warnings.
    """

    estimate: Estimate
    samples: TableSamples
    misfit: Misfit
    incidences: list[Misfit]
    channels: list[Misfit]
    verdict: str = field(default="")

    def __repr__(self) -> str:
        return f"TableFit({self.estimate!r})"

    def to_dict(self) -> dict[str, Any]:
        """The content of `result.json`."""
        content = self.estimate.to_dict()
        del content["radiometry"]
        noise, thetas = self.samples.noise, [one.theta for one in self.samples.incidences]
        return {
            **content,
            "schema": SCHEMA,
            "table": content.pop("capture"),
            "verdict": self.verdict,
            "loss": self.samples.loss.value,
            "noise": {
                "relative": noise.relative.tolist(), "floor": noise.floor.tolist(), "unit": "1/sr",
                "stated": self.samples.noise_stated,
            },
            "fit": {**content["fit"], **_errors(self.misfit)},
            "incidences": [
                {"theta_i": theta, **asdict(one)} for theta, one in zip(thetas, self.incidences, strict=True)
            ],
            "channels": [asdict(one) for one in self.channels],
        }  # fmt: skip


def fit_table(
    table: Table,
    model: str = AUTO,
    *,
    loss: str | Loss = Loss.LIKELIHOOD,
    noise: float | tuple[float, float] | None = None,
    fix: Mapping[str, Value] | None = None,
    free: Sequence[str] = (),
    tie: Mapping[str, str] | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> TableFit:
    """The model of a measured reflectance with its error bars.

    Args:
        table: from `load_table`.
        model: an expression such as "lambert+cook-torrance", or "auto".
        loss: what the fit minimises, see `Loss`.
        noise: of the likelihood, relative, or relative and floor (of f cos θi, 1/sr); None: estimated.
        fix, free, tie: as in `estimate`.
        seed: of the subsample that the search starts from.
        progress: called with a word on what is being done.

    Raises:
        InputError: unknown names, impossible constraints, no noise.
    """
    options = Options(model=model, fix=fix or {}, free=free, tie=tie or {}, seed=seed)
    return fit_table_with(table, options, Loss(loss), noise, progress)


def fit_table_with(
    table: Table,
    options: Options,
    loss: Loss = Loss.LIKELIHOOD,
    noise: float | tuple[float, float] | None = None,
    progress: Progress = silent,
) -> TableFit:
    """The model of a measured reflectance with its error bars, as options ask for it.

    Raises:
        InputError: see `fit_table`; a table that says nothing of any model.
    """
    clock = time.perf_counter()
    refuse(table.path, _faults(table))
    is_stated = noise is not None and loss is Loss.LIKELIHOOD
    pair = (noise,) if isinstance(noise, float | int) else noise
    start = stated_noise(table, *pair) if is_stated and pair else first_noise(table, loss)
    samples = TableSamples.of(table, loss, start, noise_stated=is_stated)
    expression, selection = options.model, None
    if expression is None or options.automatic:
        samples, selection = _selected(samples, options, progress)
        expression = selection.best.recipe.expression
    samples, specification, solution = _solved(expression, samples, options, progress)
    progress("error bars")
    posterior = judge(solution, samples, likelihood=loss.comparison is None)
    bars = replace(posterior.bars, kind=posterior.bars.kind.replace("images", "incidences"))
    posterior = replace(posterior, bars=bars)
    material = solution.problem.material(solution.unknowns)
    named = expression_of(material, expression)
    misfits = _misfits(samples, _model(samples, solution.problem, solution.unknowns))
    verdict = _verdict(misfits[0], named, selection is not None)
    said = [*([verdict] if verdict else []), *_where_missed(named, *misfits)]
    context = Context(
        samples, specification, solution, posterior, None, explained=selection is not None, channels=table.channels
    )
    estimate = Estimate(
        capture=str(table.path.name),
        model=named,
        material=material,
        parameters=dict(posterior.estimates),
        labels=list(posterior.labels),
        correlation=[list(row) for row in posterior.correlation],
        fit=summary(samples, solution, bars, _sentence(samples, solution, bars)),
        relative=table.relative,
        candidates=selection.candidates if selection else [],
        skipped={"components": selection.unsupported if selection else [], "samples": dict(table.skipped), "work": []},
        timing_s={"fit": time.perf_counter() - clock},
        warnings=said + warnings(context, (*GENERAL_RULES, *_RULES)),
        channel_labels=tuple(table.channels),
    )
    return TableFit(estimate, samples, *misfits, verdict)


def _faults(table: Table) -> Iterator[Fault]:
    """Why no model can be fitted to a table."""
    count = len(table)
    yield count < _MIN_PAIRS, f"expected {_MIN_PAIRS} pairs of directions or more, and it has {count}; measure more."
    largest = float(table.values.abs().max())
    yield largest > _LARGEST, f"expected reflectances in 1/sr, and one is {largest:.3g}; correct or remove it."
    yield (
        not bool((table.values > 0).any()),
        "expected reflectances above zero, and there is none; check the columns of the values.",
    )


def _selected(samples: TableSamples, options: Options, progress: Progress) -> tuple[TableSamples, Selection]:
    """The choice of the model, and the samples with the noise that it was made under.

    Where none is stated, the model chosen under a first guess leaves a better one, under which another may be better.
    """
    selection = select(samples, options, progress)
    if not samples.noise_stated:
        first = selection.best.left_out
        samples = samples.with_noise(_noise(samples, first.problem, first.unknowns))
        # Weights that are far off leave the model far off too: its residuals tell the noise only under better ones.
        solution = fit(first.problem, samples, options.seed, progress, start=first.unknowns)
        samples = samples.with_noise(_noise(samples, solution.problem, solution.unknowns))
        selection = select(samples, options, progress)
    return samples, replace(selection, unit="incidence")


def _solved(
    expression: str, samples: TableSamples, options: Options, progress: Progress
) -> tuple[TableSamples, Specification, Solution]:
    """The optimum, and the samples with the noise that its residuals show where none is stated."""
    specification, solution = solve(expression, samples, options, progress)
    if samples.noise_stated:
        return samples, specification, solution
    samples = samples.with_noise(_noise(samples, solution.problem, solution.unknowns))
    # Under the right noise: other weights may lead the search elsewhere, and determine other parameters.
    specification, solution = solve(expression, samples, options, progress)
    for _ in range(_MAX_ROUNDS):
        noise = _noise(samples, solution.problem, solution.unknowns)
        change = max(
            float((new / old - 1)[old > 0].abs().max()) if bool((old > 0).any()) else 0.0
            for new, old in zip(noise, samples.noise, strict=True)
        )
        samples = samples.with_noise(noise)
        solution = fit(specification.problem, samples, options.seed, progress, start=solution.unknowns)
        if change < _NOISE_CHANGE:
            break
    return samples, specification, solution


def _noise(samples: TableSamples, problem: Problem, unknowns: Tensor) -> TableNoise:
    """The noise that the residuals of the model at u [P] show."""
    return estimated_noise(samples.loss, samples.radiance, _model(samples, problem, unknowns), samples.variance_shares)


def _model(samples: TableSamples, problem: Problem, unknowns: Tensor) -> Tensor:
    """y = f cos θi of the model at u [P] for every row [n, C]."""
    radiance = radiance_model(problem, unknowns)
    with torch.no_grad():
        return torch.cat([radiance(tile()) for group in samples.tiles() for tile in group])


def _misfits(samples: TableSamples, model: Tensor) -> tuple[Misfit, list[Misfit], list[Misfit]]:
    """That of all values, of those of every incidence, and of those of every channel."""
    measured, weights = samples.radiance.numpy(), np.ones((len(samples), 1))
    if samples.table.measure is not None:
        weights = samples.table.measure.numpy()
    roots = [cube_root(y).numpy() for y in (samples.radiance, model)]

    def misfit(label: str, rows: slice, channels: slice) -> Misfit:
        y, mu = measured[rows, channels], model.numpy()[rows, channels]
        root, root_mu = (part[rows, channels] for part in roots)
        share = weights[rows] / weights[rows].mean()
        error, signal = (float(np.mean(share * part**2)) ** 0.5 for part in (root - root_mu, root))
        relative = float(np.square(y - mu).sum() / max(float(np.square(y).sum()), 1e-300)) ** 0.5
        return Misfit(label, y.size, relative, error, error / max(signal, 1e-300))

    every = slice(None)
    incidences = [misfit(one.label, one.rows, every) for one in samples.incidences]
    channels = [misfit(name, every, slice(c, c + 1)) for c, name in enumerate(samples.table.channels)]
    return misfit("all", every, every), incidences, channels


def _errors(misfit: Misfit) -> dict[str, float]:
    return {name: getattr(misfit, name) for name in ("cube_root_error", "relative_cube_root_error")}


def _verdict(misfit: Misfit, expression: str, automatic: bool) -> str:
    """That the model is not the material, where it is not; otherwise empty."""
    if misfit.relative_cube_root_error < _MISSED:
        return ""
    missed = f"misses the measurements by {misfit.relative_cube_root_error:.0%} (rms of cube roots)"
    if automatic:
        return f"No model of the catalogue fits this table: {expression}, the best, {missed}."
    return f"{expression} does not fit this table: it {missed}; try --model auto."


def _where_missed(expression: str, every: Misfit, incidences: list[Misfit], channels: list[Misfit]) -> Iterator[str]:
    """Where the model is farthest from the table."""
    if every.relative_cube_root_error > _WORTH_SAYING:
        angle, channel = (max(part, key=lambda one: one.relative_cube_root_error) for part in (incidences, channels))
        where = f"most with the light at {angle.label} ({angle.relative_cube_root_error:.1%})"
        where += f" and in {channel.label} ({channel.relative_cube_root_error:.1%})" if len(channels) > 1 else ""
        yield f"{expression} misses the measurements by {every.relative_cube_root_error:.1%} (cube roots), {where}."


def _sentence(samples: TableSamples, solution: Solution, bars: ErrorBars) -> str:
    """How the fit went."""
    outcome = "Converged" if solution.converged else f"Not converged after {solution.iterations} passes"
    if samples.loss.comparison is not None:
        return f"{outcome} to the least {samples.loss.value} cost; error bars from the {bars.kind}."
    if not samples.noise_stated:
        spread = "residuals are as large as noise of " + " and ".join(
            _range(part, unit)
            for part, unit in ((samples.noise.relative, "of the value"), (samples.noise.floor, "1/sr"))
        )
        return (
            f"{outcome}; {spread}, and as random."
            if bars.holds
            else f"{outcome}; {spread}, but not random ({bars.reason}), so error bars come from the {bars.kind}."
        )
    if bars.holds:
        return f"{outcome}; the model describes the measurements to their noise (reduced χ² {bars.chi2:.2f})."
    return (
        f"{outcome}; the model does not hold to the stated noise ({bars.reason}), so error bars come from the "
        f"{bars.kind}."
    )


def _range(values: Tensor, unit: str) -> str:
    """The value of all channels, or the least and the largest."""
    least, largest = f"{float(values.min()):.2g}", f"{float(values.max()):.2g}"
    return f"{least} {unit}" if least == largest else f"{least} to {largest} {unit}"


def _assumed_optics(context: Context) -> Iterator[str]:
    for name in context.specification.assumed:
        unit = context.solution.problem.declared(name).unit
        yield f"{name} is taken as {context.held(name):g} {unit}: the table does not say it; give --fix {name}=VALUE."


def _outlying_values(context: Context) -> Iterator[str]:
    count = int(context.solution.statistics.total("outliers"))
    if count:
        yield f"{count:,} values lie too far from the model to be noise and were left out of the fit."


def _few_incidences(context: Context) -> Iterator[str]:
    bars, count = context.posterior.bars, len(context.account.names)
    if not bars.holds and count < _MIN_INCIDENCES:
        yield (
            f"{count} incidences are too few for error bars that allow for the misfit of the model: these are "
            f"scaled by the residuals ({math.sqrt(bars.chi2):.3g} times the noise); {_MIN_INCIDENCES} would do."
        )


_RULES = (_assumed_optics, _outlying_values, _few_incidences)
