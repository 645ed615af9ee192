"""Tables for the terminal."""

from __future__ import annotations

from collections.abc import Mapping

from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Table
from rich.text import Text

from matest.brdf import Brdf
from matest.brdf.presets import Preset
from matest.estimation.prediction import PredictionErrors
from matest.estimation.result import Estimate
from matest.parameters import options_of, parameters_of
from matest.profiles import Comparison
from matest.report.format import channel_names, rows, share

_STATUS_STYLE = {"determined": "green", "at bound": "yellow", "not determined": "red"}


def estimate_table(estimate: Estimate) -> Group:
    """Parameters with error bars, quality of the fit, warnings."""
    table = Table(box=SIMPLE_HEAD, title=f"{estimate.capture}: {estimate.model}", title_justify="left")
    for column in ("parameter", "value ± standard error", "95 % interval", "status"):
        table.add_column(column, no_wrap=column != "value ± standard error")
    component = ""
    for name, parameter in estimate.parameters.items():
        # Parameters of a sum stand under the name of their model.
        owner, dot, short = name.rpartition(".")
        if dot and owner != component:
            component = owner
            table.add_row(Text(owner, style="bold"), "", "", "")
        for row in rows(f"  {short}" if dot else name, parameter, channel_names(estimate.channels)):
            table.add_row(*row[:-1], Text(row[-1], style=_STATUS_STYLE.get(row[-1], "")))
    fit = estimate.fit
    parts: list[object] = []
    if estimate.candidates:
        parts.append(_candidates(estimate))
    parts.append(table)
    parts.append(Text(fit.message))
    summary = f"relative rms error {fit.relative_rmse:.2%}"
    if fit.values_left_out:
        summary += f" ({fit.relative_rmse_trimmed:.2%} without the {fit.values_left_out:,} values left out as outliers)"
    summary += f", {fit.samples_used:,} of {fit.samples:,} samples"
    saturated = estimate.skipped.get("samples", {}).get("saturated", 0)
    if saturated:
        summary += f" and {saturated:,} saturated ones"
    if estimate.holdout:
        summary += f", {share(estimate.holdout['relative_rmse'])} on the images left out"
    parts.append(Text(summary + "."))
    parts += [Text(f"Note: {warning}", style="yellow") for warning in estimate.warnings]
    stages = ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in estimate.timing_s.items())
    parts.append(Text(stages, style="dim"))
    return Group(*parts)  # type: ignore[arg-type]


def summary_table(estimates: Mapping[str, Estimate | str]) -> Table:
    """One line a capture; a text instead of an estimate says why there is none."""
    table = Table(box=SIMPLE_HEAD)
    for column in ("capture", "model", "relative rms error", "status"):
        table.add_column(column)
    for name, estimate in estimates.items():
        if isinstance(estimate, str):
            table.add_row(name, "", "", Text(estimate, style="red"))
        else:
            table.add_row(name, estimate.model, f"{estimate.fit.relative_rmse:.2%}", estimate.fit.status)
    return table


def models_table(models: Mapping[str, type[Brdf]]) -> Group:
    """The catalogue: every model with its parameters, units, domains, options and source."""
    parts: list[Text | Table] = []
    for name, model in models.items():
        parts.append(Text.assemble((name, "bold"), (f"  {model.source}", "dim")))
        table = Table(box=None, show_header=False, padding=(0, 1), pad_edge=False)
        for width in (20, 14, None):
            table.add_column(min_width=width)
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


def presets_table(presets: Mapping[str, Preset]) -> Table:
    """Named materials of the papers."""
    title = Text('Materials of the papers: preset = "NAME" under [material] in a scene')
    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left")
    for column in ("preset", "material", "source"):
        table.add_column(column)
    for name, preset in presets.items():
        table.add_row(name, preset.doc + ("; give f0" if preset.needs_f0 else ""), preset.source)
    return table


def prediction_table(errors: PredictionErrors, files: list[str]) -> Table:
    """The error of every image, and of all together."""
    table = Table(box=SIMPLE_HEAD)
    table.add_column("image")
    table.add_column("relative rms error", justify="right")
    for file, error in zip(files, errors.images, strict=True):
        table.add_row(file, share(error))
    table.add_section()
    table.add_row("all together", share(errors.pooled))
    return table


def comparison_table(comparison: Comparison) -> Table:
    table = Table(box=SIMPLE_HEAD)
    table.add_column("image")
    for column in ("rms difference", "maximum", "brightest at"):
        table.add_column(column, justify="right")
    for name, rms, maximum, peak in zip(
        comparison.names, comparison.rms, comparison.maximum, comparison.peak, strict=True
    ):
        first = name == comparison.names[0]
        table.add_row(name, "reference" if first else f"{rms:.4g}", "" if first else f"{maximum:.4g}", f"{peak:.0f} px")
    return table


def _candidates(estimate: Estimate) -> Table:
    table = Table(
        box=SIMPLE_HEAD,
        title="Models tried, and their relative rms error on what was left out",
        title_justify="left",
    )
    table.add_column("model", no_wrap=True)
    table.add_column("error", justify="right")
    table.add_column("verdict")
    for candidate in estimate.candidates:
        table.add_row(candidate.model, f"{candidate.relative_rmse:.2%}", candidate.reason)
    return table
