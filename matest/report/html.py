"""Tables and small drawings of a page, of texts that come from anywhere."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence

from matest.errors import printable

# An option of the command line, which lines may break after its hyphens.
_OPTION = re.compile(r"--[a-z][a-z-]*")


def escape(text: str) -> str:
    """A text as HTML, with escapes for control characters, which names of files may have."""
    return html.escape(printable(text))


def sentence(text: str) -> str:
    """A text whose options are kept in one piece."""
    return _OPTION.sub(r'<span class="option">\g<0></span>', escape(text))


def html_table(head: Sequence[str], body: Sequence[Sequence[str]], kind: str = "", bold: Sequence[int] = ()) -> str:
    """A table of texts; `bold` are rows in bold."""
    cells = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join(
        f"<tr{' class=bold' * (number in bold)}>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
        for number, row in enumerate(body)
    )
    lines = lines.replace("\n", "<br>")
    head = f"<thead><tr>{cells}</tr></thead>"
    return f'<div class="wide"><table class="{kind}">{head}<tbody>{lines}</tbody></table></div>'


def facts(values: Mapping[str, str]) -> str:
    """Some figures with their names, side by side."""
    items = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in values.items())
    return f'<dl class="facts">{items}</dl>'


def items(texts: Sequence[str]) -> str:
    """A list of texts."""
    return f"<ul>{''.join(f'<li>{sentence(text)}</li>' for text in texts)}</ul>"


def meter(share: float, kind: str = "meter") -> str:
    """A bar that fills a share of its place."""
    width = 100 * min(max(share, 0.0), 1.0)
    return (
        f'<svg class="{kind}" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true">'
        f'<rect width="{width:.1f}" height="10"/></svg>'
    )


def time_bars(timing_s: Mapping[str, float]) -> str:
    """Seconds of every stage, beside bars of their shares of the longest."""
    stages = {stage: seconds for stage, seconds in timing_s.items() if stage != "total"}
    longest = max(stages.values(), default=0.0) or 1.0
    rows = [
        f"<span>{escape(stage)}</span><span>{seconds:.2f} s</span>{meter(seconds / longest, 'bar')}"
        for stage, seconds in stages.items()
    ]
    total = f"<p>In all {timing_s['total']:.2f} s.</p>" if "total" in timing_s else ""
    return f'<div class="times">{"".join(rows)}</div>{total}' if rows else ""


def provenance(facts_of_it: Mapping[str, object]) -> str:
    """Where a result comes from: version, command, places, and the sums of the files that were read."""
    if not facts_of_it:
        return ""
    told = [(name, str(value)) for name, value in facts_of_it.items() if name != "inputs" and value not in ("", None)]
    sums = facts_of_it.get("inputs")
    body = html_table(("", ""), told, "words")
    if isinstance(sums, Mapping) and sums:
        rows = "".join(
            f'<tr><td class="hash">{escape(str(file))}</td><td class="hash">{escape(str(digest))}</td></tr>'
            for file, digest in sums.items()
        )
        count = f"{len(sums)} file{'s' * (len(sums) != 1)}"
        table = f'<table class="words"><tbody>{rows}</tbody></table>'
        body += f"<details><summary>SHA-256 of {count} as read</summary>{table}</details>"
    return body
