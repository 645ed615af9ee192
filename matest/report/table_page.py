"""`report.html` of a fit to a measured table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matest.estimation.table_fit import Misfit, TableFit
from matest.report.document import Section, document
from matest.report.format import MISFIT_COLUMNS, chi2, misfit_cells, share
from matest.report.html import escape, html_table, items
from matest.report.page import candidates, closing_sections, heading, identifiability, parameters
from matest.report.relight import Relighting, relight_section

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


def table_page(fit: TableFit, pictures: Mapping[str, str], relit: Relighting | str) -> str:
    """The report as HTML.

    Args:
        fit: what to report.
        pictures: "slices", "incidences" and "posterior" as data URIs.
        relit: the material on a sphere, or why there is none.
    """
    estimate = fit.estimate
    sections = [
        Section("parameters", "Parameters", parameters(estimate)),
        *(Section(name, title, _figure(pictures[name], title, caption)) for name, title, caption in _PICTURES),
        Section("relight", "Relight", relight_section(estimate, relit, ["above on the right"])),
        Section("incidence", "Errors by incidence", _misfits("incidence", fit.incidences)),
        Section("channel", "Errors by channel", _misfits("channel", fit.channels)),
        Section("identifiability", "What is determined", identifiability(estimate)),
        Section("fit", "Fit", _quality(fit)),
        Section("models", "Models tried", candidates(estimate)),
        Section("skipped", "Left out", _left_out(fit)),
        *closing_sections(estimate),
    ]
    return document(f"matest: {estimate.capture}", heading(estimate), sections)


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
    return html_table([*cells], [[*cells.values()]], "words") + f"<p>{_MEANING}</p>"


def _figure(picture: str, title: str, caption: str) -> str:
    return (
        f'<figure class="plot"><img src="{picture}" alt="{escape(title)}"><figcaption>{caption}</figcaption></figure>'
    )


def _misfits(what: str, misfits: Sequence[Misfit]) -> str:
    body = [(misfit.label, *misfit_cells(misfit)) for misfit in misfits]
    return html_table((what, *MISFIT_COLUMNS), body)


def _left_out(fit: TableFit) -> str:
    """Which entries were left out; empty where none were."""
    counts = [f"{count:,} {reason}" for reason, count in fit.samples.table.skipped.items() if count]
    return items([f"entries: {', '.join(counts)}"]) if counts else ""
