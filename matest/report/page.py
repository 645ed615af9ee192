"""`report.html`: one file with the estimate's tables and pictures, in sections that a reader may jump to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from matest.estimation.result import Estimate
from matest.report import calibration, photographs
from matest.report.correlations import correlations
from matest.report.document import Section, data_block, document
from matest.report.format import (
    CANDIDATE_COLUMNS,
    CANDIDATES_LEGEND,
    PARAMETER_COLUMNS,
    candidate_cells,
    chi2,
    listed,
    rows,
    share,
)
from matest.report.html import escape, facts, html_table, items, provenance, sentence, time_bars
from matest.report.map_figures import maps_section
from matest.report.pictures import MEAN_RANGE
from matest.report.previews import PagePictures
from matest.report.relight import Relighting, relight_section

# Why pixels are left out, in the words of the page where these differ from those of the result.
_SKIPPED_PIXELS = {"held_out": "in images held out", "idle": "in images that add nothing", "unread": "not needed"}
# What the samples tell of parameters, by their status, as the page says it.
_STATUSES = {
    "determined": "Determined:",
    "at bound": "At an end of the domain, with a one-sided interval:",
    "not determined": "Not determined:",
    "tied": "Tied to another parameter:",
    "fixed": "Held at a value that was given, or that the samples do not tell:",
}
# Standard deviations of the noise at full colour of residuals, unless they are larger.
_RESIDUAL_RANGE = 5.0
# The same as a multiple of the rms residual of the worst photograph.
_RESIDUAL_MULTIPLE = 3.0
# Largest range that the page offers, as its slider has it: a power of ten.
_RANGE_POWERS = (0, 3)


def page(
    estimate: Estimate, files: list[str], pictures: PagePictures | None, relit: Relighting | str | None = None
) -> str:
    """The report as HTML.

    Args:
        estimate: what to report.
        files: names of the capture's images.
        pictures: of the page; None: there are none.
        relit: the material on the object, or why there is none; None without pictures.
    """
    title = f"{estimate.capture}: {estimate.model}"
    sections = [
        Section("parameters", "Parameters", parameters(estimate)),
        Section("photographs", "Photographs", _photographs(estimate, files, pictures)),
        Section("relight", "Relight", relight_section(estimate, relit, files)),
        Section("maps", "Maps", maps_section(estimate, None if pictures is None else pictures.maps)),
        Section("residuals", "Residuals", _residuals(estimate, pictures)),
        Section("identifiability", "What is determined", identifiability(estimate)),
        Section("correlations", "Correlations", correlations(estimate)),
        Section("calibration", calibration.TITLE, _calibration(estimate)),
        Section("diagnosis", "Diagnosis", _diagnosis(estimate)),
        Section("fit", "Fit", _fit(estimate, files)),
        Section("models", "Models tried", candidates(estimate)),
        Section("skipped", "Not computed", _skipped(estimate)),
        *closing_sections(estimate),
    ]
    return document(f"matest: {title}", heading(estimate), sections)


def heading(estimate: Estimate) -> str:
    """Title, verdict and the figures that matter most."""
    fit = estimate.fit
    values = {"relative rms error": share(fit.relative_rmse), "reduced χ²": chi2(fit.reduced_chi2)}
    if estimate.images:
        values["photographs"] = str(len(estimate.images))
    values["samples used"] = f"{fit.samples_used:,}"
    return (
        f"<h1>{escape(f'{estimate.capture}: {estimate.model}')}</h1>"
        f'<p class="lead">{escape(fit.message)}</p>{facts(values)}'
    )


def parameters(estimate: Estimate) -> str:
    """Table of the parameters, warnings."""
    channels = estimate.channel_names
    body = [
        (*row, parameter.doc)
        for name, parameter in estimate.parameters.items()
        for row in rows(name, parameter, channels)
    ]
    table = html_table((*PARAMETER_COLUMNS, "meaning"), body)
    return "\n".join([table, *(f'<p class="warning">{sentence(warning)}</p>' for warning in estimate.warnings)])


def closing_sections(estimate: Estimate) -> list[Section]:
    """Run time and origin."""
    return [
        Section("time", "Time", time_bars(estimate.timing_s)),
        Section("provenance", "Provenance", provenance(estimate.provenance)),
    ]


def candidates(estimate: Estimate) -> str:
    """The models that were tried; empty where one was named."""
    if not estimate.candidates:
        return ""
    body = [candidate_cells(each) for each in estimate.candidates]
    chosen = [row for row, each in enumerate(estimate.candidates) if each.chosen]
    return f'{html_table(CANDIDATE_COLUMNS, body, "words", bold=chosen)}<p class="lead">{CANDIDATES_LEGEND}</p>'


def identifiability(estimate: Estimate) -> str:
    """Which parameters the samples tell, by status."""
    groups: dict[str, list[str]] = {}
    for name, parameter in estimate.parameters.items():
        groups.setdefault(parameter.status, []).append(name)
    told = [f"{_STATUSES.get(status, status)} {listed(names)}." for status, names in groups.items()]
    if estimate.relative:
        told.append("The strength of the lights is not known: albedos are known up to one common factor.")
    return items(told)


def _calibration(estimate: Estimate) -> str:
    """Errors of the calibration; empty where none were refined or allowed for."""
    if not estimate.nuisance:
        return ""
    body = [
        (*cells, errors.doc)
        for cells, errors in zip(calibration.error_rows(estimate), estimate.nuisance.values(), strict=True)
    ]
    return f"<p>{calibration.legend(estimate)}</p>\n{html_table((*calibration.COLUMNS, 'meaning'), body)}"


def _diagnosis(estimate: Estimate) -> str:
    """Causes of residuals; that there are none where the model describes photographs, or that none were looked for."""
    if not estimate.diagnosis and estimate.maps:
        return "<p>Beside maps, causes of residuals are not looked for.</p>"
    if not estimate.diagnosis:
        return "<p>No cause of residuals beside the noise was found.</p>" if estimate.images else ""
    body = [(cause.message, chi2(cause.chi2_before), chi2(cause.chi2_after)) for cause in estimate.diagnosis]
    return html_table(("cause and mend", "χ² without", "χ² with it"), body, "words")


def _fit(estimate: Estimate, files: list[str]) -> str:
    """How well the model describes the images."""
    fit = estimate.fit
    cells = {
        "relative rms error": share(fit.relative_rmse),
        "reduced χ²": chi2(fit.reduced_chi2),
        "samples used": f"{fit.samples_used:,}",
        "samples in all": f"{fit.samples:,}",
        "passes": str(fit.iterations),
        "error bars from": fit.errors.replace("fisher", "Fisher information"),
    }
    return html_table([*cells], [[*cells.values()]]) + _holdout(estimate, files)


def _holdout(estimate: Estimate, files: list[str]) -> str:
    """The error on the images held out; empty where none are."""
    if not estimate.holdout:
        return ""
    images = ", ".join(f"{number} ({escape(files[number])})" for number in estimate.holdout["images"])
    error, median = (share(estimate.holdout[kind]) for kind in ("relative_rmse", "median_error"))
    return f"<p>Held out of the fit, image {images}: relative rms error {error}, median error of a pixel {median}.</p>"


def _photographs(estimate: Estimate, files: Sequence[str], pictures: PagePictures | None) -> str:
    """The photographs, worst first, and a viewer of the one that is chosen; empty for a table."""
    if not estimate.images and pictures is None:
        return ""
    legend = photographs.legend_of(estimate.images)
    viewer = pictures is not None and bool(pictures.previews)
    how = "a name shows its pictures, a head sorts, arrow keys go from row to row" if viewer else "a head sorts"
    parts = [
        f'<p class="lead">The worst first; {how}.</p>',
        photographs.sortable_table(estimate.images, files, viewer=viewer),
        f'<p class="lead">{escape(legend)}</p>' if legend else "",
    ]
    if pictures is not None and viewer:
        parts.append(_viewer(estimate, files, pictures))
    return "\n".join(parts)


def _viewer(estimate: Estimate, files: Sequence[str], pictures: PagePictures) -> str:
    """The pictures of one photograph and their data."""
    worst = max((image.reduced_chi2 for image in estimate.images), default=1.0)
    span = max(_RESIDUAL_RANGE, _RESIDUAL_MULTIPLE * worst**0.5)
    low, high = _RANGE_POWERS
    order = {image.file: place for place, image in enumerate(photographs.worst_first(estimate.images))}
    sorted_previews = sorted(pictures.previews, key=lambda small: order.get(small.name, len(files)))
    refined = any(errors.refined for errors in estimate.nuisance.values())
    stated = " Pictures are of the calibration as stated, without the errors that were refined." if refined else ""
    line = '<svg viewBox="0 0 100 100" preserveAspectRatio="none" aria-hidden="true"><line/></svg>'
    handles = "".join(
        f'<span class="handle {end}" tabindex="0" role="button" aria-label="{label} of the line; arrow keys move it">'
        "</span>"
        for end, label in (("from", "start"), ("to", "end"))
    )
    links = ", ".join(
        f'<a data-kind="{kind}">{caption}</a>'
        for kind, caption in (("photo", "photograph"), ("render", "model"), ("residual", "difference"))
    )
    return (
        f'<div class="viewer" id="viewer" data-range="{min(span, 10**high):.4g}">'
        '<p class="heading"><span class="name"></span> <small class="step"></small> '
        f'<small class="full" hidden>full size: {links}</small></p>'
        f'<figure class="compare"><div class="pad"><img class="render" alt="model">'
        f'<img class="photo" alt="photograph"><span class="bar"></span>{line}{handles}'
        '<span class="tag left">photograph</span><span class="tag right">model</span></div>'
        '<input type="range" class="split" min="0" max="100" value="50" aria-label="photograph before the model">'
        "<figcaption>Photograph and model at one exposure: drag between them.</figcaption></figure>"
        f'<figure class="residuals"><div class="pad"><canvas class="residual"></canvas>{line}</div>'
        f'<input type="range" class="range" min="{low}" max="{high}" step="0.02" aria-label="range of the residual">'
        '<div class="ramp"></div><figcaption>Photograph minus model in standard deviations σ of the noise: '
        '<output class="range"></output>. Grey did not count (background, rim, shadow, outlier, clipped alike).'
        f"{stated}</figcaption></figure>"
        '<figure class="chart"><svg class="profile" role="img" aria-label="brightness along the line"></svg>'
        '<figcaption><span class="key measured">── photograph</span>, <span class="key modelled">── model</span>: '
        "mean of the channels along the line, whose ends can be dragged. "
        '<span class="reading" role="status"></span></figcaption></figure></div>'
        f"{data_block('photographs-data', [asdict(small) for small in sorted_previews])}"
    )


def _residuals(estimate: Estimate, pictures: PagePictures | None) -> str:
    """Residuals by angle, and their mean over the photographs where there are pictures and several of them."""
    figures, legend = photographs.angle_drawings(estimate.residuals)
    said = [f"<p>Residuals by angle: {legend}.</p>"] if figures else []
    if pictures is not None and pictures.mean_residual:
        figures.append((f'<img src="{pictures.mean_residual}" alt="mean residual">', "mean over the photographs"))
        said.append(
            "<p>Mean over the photographs: where all of them are brighter (red) or darker (blue) than the model, full "
            f"colour at {MEAN_RANGE:.0%} of the rms brightness.</p>"
        )
    if not figures:
        return ""
    shown = "".join(f"<figure>{drawn}<figcaption>{escape(text)}</figcaption></figure>" for drawn, text in figures)
    return "\n".join([*said, f'<div class="images">{shown}</div>'])


def _skipped(estimate: Estimate) -> str:
    """Which pixels, lobes and work were left out."""
    pixels = ", ".join(
        f"{count:,} {_SKIPPED_PIXELS.get(reason, reason)}"
        for reason, count in estimate.skipped.get("samples", {}).items()
        if count
    )
    lobes = ", ".join(estimate.skipped.get("components", []))
    work = [f"lobes that the images do not support: {lobes}"] if lobes else []
    return items([f"pixels of all images: {pixels or 'none'}", *work, *estimate.skipped.get("work", [])])
