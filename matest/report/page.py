"""`report.html`: one static page with the estimate's table and pictures."""

from __future__ import annotations

from html import escape

from matest.estimation.result import Estimate
from matest.report.format import channel_names, chi2, rows, share
from matest.report.pictures import RESIDUAL_RANGE

_STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #888; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; } h2 { font-size: 1.1rem; margin-top: 2rem; }
.lead { color: var(--soft); margin-top: .2rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
td:nth-child(2), td:nth-child(3) { white-space: nowrap; } table.words td:nth-child(3) { white-space: normal; }
th, td { text-align: left; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th { font-weight: 600; } .warning { border-left: 4px solid #c80; padding-left: .8rem; margin: .4rem 0; }
.images { display: grid; grid-template-columns: repeat(3, 1fr); gap: .8rem; }
figure { margin: 0; } figure img { width: 100%; image-rendering: auto; background: #000; }
figcaption { font-size: .85rem; color: var(--soft); }
"""


def page(estimate: Estimate, files: list[str]) -> str:
    """The report as HTML; pictures are referred to by their place in the result folder.

    Args:
        estimate: what to report.
        files: names of the capture's images.
    """
    fit = estimate.fit
    parts = [
        f"<h1>{escape(estimate.capture)}: {escape(estimate.model)}</h1>",
        f'<p class="lead">{escape(fit.message)}</p>',
        _table(
            ("parameter", "value ± standard error", "95 % interval", "status", ""),
            [
                (*row, parameter.doc)
                for name, parameter in estimate.parameters.items()
                for row in rows(name, parameter, channel_names(estimate.channels))
            ],
        ),
        *(f'<p class="warning">{escape(warning)}</p>' for warning in estimate.warnings),
        "<h2>Fit</h2>",
        _table(
            ("relative rms error", "reduced χ²", "samples used", "of", "passes", "error bars from"),
            [
                (
                    f"{fit.relative_rmse:.2%}",
                    chi2(fit.reduced_chi2),
                    f"{fit.samples_used:,}",
                    f"{fit.samples:,}",
                    str(fit.iterations),
                    fit.errors.replace("fisher", "Fisher information"),
                )
            ],
        ),
    ]
    if estimate.holdout:
        left = ", ".join(f"{number} ({escape(files[number])})" for number in estimate.holdout["images"])
        error = share(estimate.holdout["relative_rmse"])
        parts.append(f"<p>Held out of the fit, image {left}: relative rms error {error}.</p>")
    if estimate.candidates:
        parts.append("<h2>Models tried, and their relative rms error on what was left out</h2>")
        parts.append(
            _table(
                ("model", "error", "verdict"),
                [(c.model, f"{c.relative_rmse:.2%}", c.reason) for c in estimate.candidates],
                "words",
            )
        )
    parts.append("<h2>Images</h2>")
    parts.append(
        f"<p>Photograph, the estimated material under the same light, and their difference: red where the photograph "
        f"is brighter, blue where it is darker, full colour at {RESIDUAL_RANGE:.0%} of the rms brightness, "
        "grey where a pixel did not count (background, rim, shadow, saturation).</p>"
    )
    parts.append('<div class="images">')
    for number, file in enumerate(files):
        for kind, caption in (("photo", "photograph"), ("render", "model"), ("residual", "difference")):
            source = f"images/{number:02d}_{kind}.png"
            parts.append(
                f'<figure><img src="{source}" alt="{caption} {number}" loading="lazy">'
                f"<figcaption>{escape(file)}: {caption}</figcaption></figure>"
            )
    parts.append("</div>")
    parts += ["<h2>Not computed</h2>", _skipped(estimate), "<h2>Time</h2>", _timing(estimate)]
    title = escape(f"matest: {estimate.capture}")
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head><body>'
        + "\n".join(parts)
        + "</body></html>\n"
    )


def _table(head: tuple[str, ...], body: list[tuple[str, ...]], kind: str = "") -> str:
    cells = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join("<tr>" + "".join(f"<td>{_cell(cell)}</td>" for cell in row) + "</tr>" for row in body)
    return f'<table class="{kind}"><thead><tr>{cells}</tr></thead><tbody>{lines}</tbody></table>'


def _cell(text: str) -> str:
    return escape(text).replace("\n", "<br>")


def _skipped(estimate: Estimate) -> str:
    told = {"held_out": "in images held out", "idle": "in images that add nothing", "unread": "not needed"}
    counts = [
        f"{count:,} {told.get(reason, reason)}"
        for reason, count in estimate.skipped.get("samples", {}).items()
        if count
    ]
    lobes = ", ".join(estimate.skipped.get("components", []))
    work = [f"lobes that the images do not support: {lobes}"] if lobes else []
    items = [f"pixels of all images: {', '.join(counts) or 'none'}", *work, *estimate.skipped.get("work", [])]
    return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>"


def _timing(estimate: Estimate) -> str:
    stages = ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in estimate.timing_s.items())
    return f"<p>{escape(stages)}</p>"
