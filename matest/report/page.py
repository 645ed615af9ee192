"""`report.html`: one static page with the estimate's table and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from matest.estimation.result import Estimate
from matest.report import calibration, photographs
from matest.report.format import (
    CANDIDATE_COLUMNS,
    CANDIDATES_LEGEND,
    CANDIDATES_TITLE,
    PARAMETER_COLUMNS,
    candidate_cells,
    chi2,
    rows,
    share,
    stages,
)
from matest.report.map_figures import maps_section, style
from matest.report.pictures import MEAN_RANGE, MEAN_RESIDUAL, RESIDUAL_RANGE

_STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #888; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; } h2 { font-size: 1.1rem; margin-top: 2rem; }
.lead { color: var(--soft); margin-top: .2rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
td:nth-child(2), td:nth-child(3) { white-space: nowrap; } table.words td:nth-child(3) { white-space: normal; }
table.numbers td:nth-child(n+2) { white-space: nowrap; } table.numbers td { overflow-wrap: anywhere; }
table.words td { overflow-wrap: anywhere; min-width: 4em; }
th, td { text-align: left; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th, tr.bold td { font-weight: 600; } .warning { border-left: 4px solid #c80; padding-left: .8rem; margin: .4rem 0; }
.images { display: grid; grid-template-columns: repeat(3, 1fr); gap: .8rem; }
figure { margin: 0; } figure img { width: 100%; image-rendering: auto; background: #000; }
figcaption { font-size: .85rem; color: var(--soft); }
"""
# Why pixels are left out, in the words of the page where these differ from those of the result.
_SKIPPED_PIXELS = {"held_out": "in images held out", "idle": "in images that add nothing", "unread": "not needed"}


def page(estimate: Estimate, files: list[str], step: int | None = 1) -> str:
    """The report as HTML; pictures are referred to by their place in the result folder.

    Args:
        estimate: what to report.
        files: names of the capture's images.
        step: distance in pixels between those that the pictures show; None: there are no pictures.
    """
    sections = (
        parameters(estimate),
        _calibration(estimate),
        maps_section(estimate, previews=step is not None),
        _fit(estimate),
        _holdout(estimate, files),
        candidates(estimate),
        _photographs(estimate),
        _residuals(estimate, len(files), step),
        _images(estimate, files, step),
        _skipped(estimate),
        f"<h2>Time</h2>\n<p>{escape(stages(estimate.timing_s))}</p>",
    )
    return document(estimate.capture, sections)


def document(title: str, sections: Sequence[str]) -> str:
    """A page of some sections, of which empty ones are left away."""
    title = escape(f"matest: {title}")
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}{style()}</style></head><body>'
        + "\n".join(section for section in sections if section)
        + "</body></html>\n"
    )


def parameters(estimate: Estimate) -> str:
    """Title, verdict, table of the parameters, warnings."""
    channels = estimate.channel_names
    body = [
        (*row, parameter.doc)
        for name, parameter in estimate.parameters.items()
        for row in rows(name, parameter, channels)
    ]
    return "\n".join(
        [
            f"<h1>{escape(estimate.capture)}: {escape(estimate.model)}</h1>",
            f'<p class="lead">{escape(estimate.fit.message)}</p>',
            html_table((*PARAMETER_COLUMNS, "meaning"), body),
            *(f'<p class="warning">{escape(warning)}</p>' for warning in estimate.warnings),
        ]
    )


def _calibration(estimate: Estimate) -> str:
    """Errors of the calibration; empty where none were refined or allowed for."""
    if not estimate.nuisance:
        return ""
    body = [
        (*cells, errors.doc)
        for cells, errors in zip(calibration.error_rows(estimate), estimate.nuisance.values(), strict=True)
    ]
    table = html_table((*calibration.COLUMNS, "meaning"), body)
    return f"<h2>{calibration.TITLE}</h2>\n<p>{calibration.legend(estimate)}</p>\n{table}"


def _fit(estimate: Estimate) -> str:
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
    return "<h2>Fit</h2>\n" + html_table([*cells], [[*cells.values()]])


def _holdout(estimate: Estimate, files: list[str]) -> str:
    """The error on the images held out; empty where none are."""
    if not estimate.holdout:
        return ""
    images = ", ".join(f"{number} ({escape(files[number])})" for number in estimate.holdout["images"])
    error, median = (share(estimate.holdout[kind]) for kind in ("relative_rmse", "median_error"))
    return f"<p>Held out of the fit, image {images}: relative rms error {error}, median error of a pixel {median}.</p>"


def candidates(estimate: Estimate) -> str:
    """The models that were tried; empty where one was named."""
    if not estimate.candidates:
        return ""
    body = [candidate_cells(each) for each in estimate.candidates]
    chosen = [row for row, each in enumerate(estimate.candidates) if each.chosen]
    table = html_table(CANDIDATE_COLUMNS, body, "words", bold=chosen)
    return f'<h2>{CANDIDATES_TITLE}</h2>\n{table}<p class="lead">{CANDIDATES_LEGEND}</p>'


def _photographs(estimate: Estimate) -> str:
    """The photographs that were fitted, worst first; empty for a table."""
    if not estimate.images:
        return ""
    head, body, odd = photographs.photograph_table(estimate.images)
    legend = f"{photographs.not_shown(estimate.images)}{photographs.legend_of(estimate.images)}"
    table = html_table(head, body, "numbers", odd)
    said = f'<p class="lead">{escape(legend)}</p>' if legend else ""
    return f"<h2>{photographs.TITLE}</h2>\n{table}{said}"


def _residuals(estimate: Estimate, count: int, step: int | None) -> str:
    """Residuals by angle, and their mean over the photographs where there are pictures and several of them."""
    figures, legend = photographs.angle_drawings(estimate.residuals)
    said = [f"<p>Residuals by angle: {legend}.</p>"] if figures else []
    if step is not None and count > 1:
        figures.append((f'<img src="{MEAN_RESIDUAL}" alt="mean residual" loading="lazy">', "mean over the photographs"))
        said.append(
            "<p>Mean over the photographs: where all of them are brighter (red) or darker (blue) than the model, full "
            f"colour at {MEAN_RANGE:.0%} of the rms brightness.</p>"
        )
    if not figures:
        return ""
    shown = "".join(f"<figure>{drawn}<figcaption>{escape(text)}</figcaption></figure>" for drawn, text in figures)
    return "\n".join(["<h2>Residuals</h2>", *said, f'<div class="images">{shown}</div>'])


def _images(estimate: Estimate, files: list[str], step: int | None) -> str:
    """The pictures of every image in a row; empty where there are none."""
    if step is None:
        return ""
    figures = [
        f'<figure><img src="images/{number:02d}_{kind}.png" alt="{caption} {number}" loading="lazy">'
        f"<figcaption>{escape(file)}: {caption}</figcaption></figure>"
        for number, file in enumerate(files)
        for kind, caption in (("photo", "photograph"), ("render", "model"), ("residual", "difference"))
    ]
    refined = any(errors.refined for errors in estimate.nuisance.values())
    stated = " Pictures are of the calibration as stated, without the errors that were refined." if refined else ""
    preview = f" Each picture shows one pixel of every {step}×{step}; --pictures full draws all." if step > 1 else ""
    legend = (
        "<p>Photograph, the estimated material under the same light, and their difference: red where the photograph "
        f"is brighter, blue where it is darker, full colour at {RESIDUAL_RANGE:.0%} of the rms brightness, "
        "grey where a pixel did not count (background, rim, shadow, all channels clipped). A clipped channel counts as "
        f"agreement where the model lies beyond the clip.{preview}{stated}</p>"
    )
    return "\n".join(["<h2>Images</h2>", legend, '<div class="images">', *figures, "</div>"])


def html_table(head: Sequence[str], body: Sequence[Sequence[str]], kind: str = "", bold: Sequence[int] = ()) -> str:
    """A table of texts; `bold` are rows in bold."""
    cells = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join(
        f"<tr{' class=bold' * (number in bold)}>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
        for number, row in enumerate(body)
    )
    lines = lines.replace("\n", "<br>")
    return f'<table class="{kind}"><thead><tr>{cells}</tr></thead><tbody>{lines}</tbody></table>'


def _skipped(estimate: Estimate) -> str:
    """Which pixels, lobes and work were left out."""
    pixels = ", ".join(
        f"{count:,} {_SKIPPED_PIXELS.get(reason, reason)}"
        for reason, count in estimate.skipped.get("samples", {}).items()
        if count
    )
    lobes = ", ".join(estimate.skipped.get("components", []))
    work = [f"lobes that the images do not support: {lobes}"] if lobes else []
    items = [f"pixels of all images: {pixels or 'none'}", *work, *estimate.skipped.get("work", [])]
    return f"<h2>Not computed</h2>\n<ul>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>"
