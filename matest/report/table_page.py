"""`report.html` of a fit to a measured table."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from matest.estimation.table_fit import Misfit, TableFit
from matest.report.format import MISFIT_COLUMNS, chi2, misfit_cells, share, stages
from matest.report.page import candidates, document, html_table, parameters

# Pictures of the page, and what they show.
_PICTURES = (
    (
        "slices",
        "Slices in the plane of incidence",
        "Dots are measured, curves the model; the mirror's side of the normal is to the right, dotted the mirror "
        "direction. The reflectance is on a logarithmic scale.",
    ),
    ("incidences", "Error by incidence", "Relative rms error of f cos θi under each polar angle of the light."),
    (
        "posterior",
        "Estimates and their correlation",
        "Estimates with 95 % intervals, and how errors of one hang together with those of another.",
    ),
)
_MEANING = (
    "The values compared are y = f cos θi. Relative rms error: rms difference of y over the rms of y, ruled by what is "
    "bright. Error of cube roots: rms difference of ∛y, ruled by all alike."
)


def table_page(fit: TableFit) -> str:
    """The report as HTML; pictures are referred to by their place in the result folder."""
    estimate = fit.estimate
    sections = (
        parameters(estimate),
        _quality(fit),
        *(_figure(*picture) for picture in _PICTURES),
        _misfits("Errors by incidence", "incidence", fit.incidences),
        _misfits("Errors by channel", "channel", fit.channels),
        candidates(estimate),
        _left_out(fit),
        f"<h2>Time</h2>\n<p>{escape(stages(estimate.timing_s))}</p>",
    )
    return document(estimate.capture, sections)


def _quality(fit: TableFit) -> str:
    """How well the model describes the table."""
    outcome, noise = fit.estimate.fit, fit.samples.noise
    cells = {
        "cost": fit.samples.loss.value,
        "relative rms error": share(fit.misfit.relative_rmse),
        "error of cube roots": f"{fit.misfit.cube_root_error:.4f}",
        "reduced χ²": chi2(outcome.reduced_chi2),
        "pairs of directions": f"{outcome.samples:,}",
        "error bars from": outcome.errors.replace("fisher", "Fisher information"),
    }
    if fit.samples.loss.comparison is None:
        origin = "stated" if fit.samples.noise_stated else "estimated from the residuals"
        relative, floor = float(noise.relative.median()), float(noise.floor.median())
        cells[f"noise, {origin}"] = f"{relative:.2g} of the value, floor {floor:.2g}"
    return "<h2>Fit</h2>\n" + html_table([*cells], [[*cells.values()]], "words") + f"<p>{_MEANING}</p>"


def _figure(name: str, title: str, caption: str) -> str:
    return (
        f'<h2>{escape(title)}</h2>\n<figure><img src="images/{name}.png" alt="{escape(title)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _misfits(title: str, what: str, misfits: Sequence[Misfit]) -> str:
    body = [(misfit.label, *misfit_cells(misfit)) for misfit in misfits]
    return f"<h2>{title}</h2>\n" + html_table((what, *MISFIT_COLUMNS), body)


def _left_out(fit: TableFit) -> str:
    """Which entries were left out; empty where none were."""
    counts = [f"{count:,} {reason}" for reason, count in fit.samples.table.skipped.items() if count]
    return f"<h2>Left out</h2>\n<p>Entries: {escape(', '.join(counts))}.</p>" if counts else ""
