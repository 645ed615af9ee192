"""Tables for the terminal."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from matest.brdf import Brdf
from matest.brdf.presets import Preset
from matest.estimation.prediction import PredictionErrors
from matest.estimation.recipes import LAST_LEVEL_OF_ALL, Recipe
from matest.estimation.result import Estimate
from matest.estimation.table_fit import Misfit, TableFit
from matest.parameters import options_of, parameters_of
from matest.profiles import Comparison
from matest.report import calibration
from matest.report.format import (
    CANDIDATE_COLUMNS,
    CANDIDATES_LEGEND,
    CANDIDATES_TITLE,
    MISFIT_COLUMNS,
    PARAMETER_COLUMNS,
    candidate_cells,
    listed,
    misfit_cells,
    rows,
    share,
    stages,
    status_sentences,
)

_STATUS_STYLES = {
    "determined": "green",
    "not determined": "red",
    **dict.fromkeys(("weak", "held", "at bound"), "yellow"),
}
# Columns of the words for a surface: beside them the longest model takes two lines of 80 columns.
_SURFACE_WIDTH = 28
Item = TypeVar("Item")


def plain_table(*columns: str | Column, title: str | Text | None = None) -> Table:
    """An empty table with a line under its head."""
    return Table(*columns, box=SIMPLE_HEAD, title=title, title_justify="left")


def add_parameters(
    table: Table, parameters: Mapping[str, Item], rows_of: Callable[[str, Item], Iterable[Sequence[str]]]
) -> None:
    """Add the rows of every parameter, those of a sum under the name of their model.

    Args:
        table: takes the rows; its last column is the status.
        parameters: by name (in a sum: by path).
        rows_of: the cells of a parameter's rows, given how the table calls it.
    """
    component = ""
    for path, parameter in parameters.items():
        owner, dot, name = path.rpartition(".")
        if dot and owner != component:
            component = owner
            table.add_row(Text(owner, style="bold"))
        for *cells, status in rows_of(f"  {name}" if dot else path, parameter):
            table.add_row(*cells, in_colour(status, status))


def in_colour(text: str, status: str) -> Text:
    """A text about a parameter in the colour of its status."""
    return Text(text, style=_STATUS_STYLES.get(status, ""))


def estimate_table(estimate: Estimate) -> Group:
    """Parameters with error bars, quality of the fit, warnings."""
    columns = (Column(name, no_wrap=name != "value ± standard error") for name in PARAMETER_COLUMNS)
    table = plain_table(*columns, title=f"{estimate.capture}: {estimate.model}")
    channels = estimate.channel_names
    add_parameters(table, estimate.parameters, lambda label, parameter: rows(label, parameter, channels))
    return Group(
        *(_candidates(estimate) if estimate.candidates else ()),
        table,
        *(_calibration(estimate) if estimate.nuisance else ()),
        Text(estimate.fit.message),
        Text(_errors(estimate)),
        *(Text(sentence) for sentence in _means(estimate)),
        *(Text(sentence) for sentence in status_sentences(estimate.maps)),
        *(Text(f"Note: {warning}", style="yellow") for warning in estimate.warnings),
        Text(stages(estimate.timing_s), style="dim"),
    )


def _means(estimate: Estimate) -> list[str]:
    """Which values of the table are means of maps, as a sentence; none where none is."""
    means = [name for name in estimate.maps if estimate.parameters[name].value is not None]
    return [f"Values of {listed(means)} in the table are means over the pixels."] if means else []


def _calibration(estimate: Estimate) -> tuple[Table, Text, Text]:
    """Errors of the calibration and what they are of the error bars, what the columns are, and an empty line."""
    name, number, size, *others = calibration.COLUMNS
    columns = name, Column(number, justify="right"), Column(size, no_wrap=True)
    table = plain_table(*columns, *others, title=calibration.TITLE)
    for name, *cells, limits in calibration.error_rows(estimate):
        # One name a line, that of a sum's model on one of its own: the table keeps within 80 columns.
        table.add_row(name.replace(" ", "\n"), *cells, limits.replace(", ", "\n").replace(".", ".\n  "))
    return table, Text(calibration.legend(estimate), style="dim"), Text()


def _errors(estimate: Estimate) -> str:
    """The error of the fit and what it is of, in a sentence."""
    fit = estimate.fit
    sentence = f"relative rms error {share(fit.relative_rmse)}"
    if fit.values_left_out:
        trimmed = share(fit.relative_rmse_trimmed)
        left_out = fit.values_left_out
        values = "the value" if left_out == 1 else f"the {left_out:,} values"
        sentence += f" ({trimmed} without {values} left out as {'an outlier' if left_out == 1 else 'outliers'})"
    sentence += f", {fit.samples_used:,} of {fit.samples:,} samples"
    if saturated := estimate.skipped.get("samples", {}).get("saturated", 0):
        sentence += f" and {saturated:,} with a saturated channel"
    if estimate.holdout:
        error, median = (share(estimate.holdout[kind]) for kind in ("relative_rmse", "median_error"))
        sentence += f", {error} on the images left out (median error of a pixel {median})"
    return sentence + "."


def fit_table(fit: TableFit) -> Group:
    """A model fitted to a measured table: parameters, quality of the fit, and the errors by incidence and channel."""
    return Group(
        estimate_table(fit.estimate), misfit_table("incidence", fit.incidences), misfit_table("channel", fit.channels)
    )


def misfit_table(what: str, misfits: Iterable[Misfit]) -> Table:
    """How far a model is from parts of a measured table."""
    table = plain_table(what, *(Column(name, justify="right") for name in MISFIT_COLUMNS))
    for misfit in misfits:
        table.add_row(misfit.label, *misfit_cells(misfit))
    return table


def models_table(models: Mapping[str, type[Brdf]]) -> Group:
    """The catalogue: every model with its parameters, units, domains, options and source."""
    parts: list[Text | Table] = []
    for name, model in models.items():
        parts.append(Text.assemble((name, "bold"), (f"  {model.source}", "dim")))
        columns = (Column(min_width=width) for width in (20, 14, None))
        table = Table(*columns, box=None, show_header=False, padding=(0, 1), pad_edge=False)
        for parameter, declared in parameters_of(model).items():
            unit = "" if declared.unit == "1" else f" {declared.unit}"
            meaning = declared.doc + (f"; held at {declared.held:g} unless determined" if declared.held else "")
            for option, values in declared.when.items():
                meaning += f"; with {option} = {' | '.join(values)}"
            table.add_row(f"  {parameter}", f"{declared.domain}{unit}", Text(meaning))
        for option, choices in options_of(model).items():
            default = model.__dataclass_fields__[option].default  # type: ignore[attr-defined]
            table.add_row(f"  {option} =", "", " | ".join(c + " (default)" * (c == default) for c in choices))
        parts += [table, Text()]
    return Group(*parts)


def recipes_table(recipes: Sequence[Recipe]) -> Table:
    """What `auto` tries: kinds of surfaces and their models, in the parts that it tries one after the other."""
    title = Text("What --model auto tries, part after part until no mixture would do better")
    table = plain_table(Column("surface", max_width=_SURFACE_WIDTH), "model", title=title)
    for recipe, following in itertools.zip_longest(recipes, recipes[1:]):
        surface = f"{recipe.surface}, or {recipe.dielectric}" if recipe.dielectric else recipe.surface
        is_last = following is not None and following.level > max(recipe.level, LAST_LEVEL_OF_ALL)
        # A line may break after a comma, and the expression may be copied with the space.
        table.add_row(surface, recipe.expression.replace(",", ", "), end_section=is_last)
    return table


def presets_table(presets: Mapping[str, Preset]) -> Table:
    """Named materials of the papers."""
    # A text, because a plain title takes [material] for markup.
    title = Text('Materials of the papers: preset = "NAME" under [material] in a scene')
    table = plain_table("preset", "material", "source", title=title)
    for name, preset in presets.items():
        table.add_row(name, preset.doc + ("; give f0" if preset.needs_f0 else ""), preset.source)
    return table


def prediction_table(errors: PredictionErrors, files: list[str]) -> Table:
    """The errors of every image, and of all together."""
    columns = (Column(name, justify="right") for name in ("relative rms error", "median error of a pixel"))
    table = plain_table("image", *columns)
    for file, error, median in zip(files, errors.images, errors.medians, strict=True):
        table.add_row(file, share(error), share(median))
    table.add_section()
    table.add_row("all together", share(errors.pooled), share(errors.pooled_median))
    return table


def comparison_table(comparison: Comparison, notes: Sequence[str] = ()) -> Group:
    """How much every image differs from the first, and notes on that."""
    numbers = (Column(name, justify="right") for name in ("rms difference", "maximum", "brightest at"))
    table = plain_table("image", *numbers)
    figures = zip(comparison.names, comparison.rms, comparison.maximum, comparison.peak, strict=True)
    for name, rms, maximum, peak in figures:
        first = name == comparison.names[0]
        table.add_row(name, "reference" if first else f"{rms:.4g}", "" if first else f"{maximum:.4g}", f"{peak:.0f} px")
    return Group(table, *(Text(f"Note: {note}", style="yellow") for note in notes))


def _candidates(estimate: Estimate) -> tuple[Table, Text, Text]:
    """The models that were tried, what they were judged on, and an empty line."""
    model, *errors, verdict = CANDIDATE_COLUMNS
    columns = [Column(name, justify="right") for name in errors]
    table = plain_table(Column(model, no_wrap=True), *columns, Column(verdict, overflow="fold"), title=CANDIDATES_TITLE)
    for candidate in estimate.candidates:
        expression, *rest = candidate_cells(candidate)
        table.add_row(_in_lines(expression), *rest, style="bold" if candidate.chosen else "")
    return table, Text(CANDIDATES_LEGEND, style="dim"), Text()


def _in_lines(expression: str) -> str:
    """The expression of a model with one option a line: side by side they would take the width of the table."""
    return expression.replace("+", "\n+").replace("(", "\n  (").replace(",", ",\n   ")
