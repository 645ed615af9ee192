"""A page that is one file: style, scripts and data in line, nothing loaded from anywhere, no script but its own."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from typing import Any, NamedTuple

from matest.outputs import json_text
from matest.report.assets import asset
from matest.report.html import escape

# Scripts of every page, in the order in which they need each other.
_SCRIPTS = ("numbers.js", "tables.js", "curves.js", "viewer.js", "relight.js", "sliders.js")

# What a browser shows that runs no script.
_WITHOUT_SCRIPT = '<noscript><p class="lead">A script of this page draws its pictures; it does not run.</p></noscript>'


class Section(NamedTuple):
    """A part of a page.

    Attributes:
        anchor: its name in links.
        title: its heading.
        body: HTML; a section without any is left away.
    """

    anchor: str
    title: str
    body: str


def document(title: str, head: str, sections: Sequence[Section]) -> str:
    """A page.

    Args:
        title: of the window, as plain text.
        head: HTML before the sections.
        sections: of the page.
    """
    present = [section for section in sections if section.body]
    links = "".join(f'<li><a href="#{section.anchor}">{escape(section.title)}</a></li>' for section in present)
    parts = "\n".join(
        f'<section id="{section.anchor}"><h2>{escape(section.title)}</h2>\n{section.body}\n</section>'
        for section in present
    )
    script = "\n".join(asset(name) for name in _SCRIPTS)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_policy(script)}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title>\n<style>\n{asset('page.css')}</style></head>\n<body>"
        f'<nav aria-label="sections"><ul>{links}</ul></nav>\n'
        f"<main>\n<header>{head}{_WITHOUT_SCRIPT}</header>\n{parts}\n</main>\n"
        f"<script>{script}</script>\n</body></html>\n"
    )


def _policy(script: str) -> str:
    """What a browser may do: run this one script, apply the page's own style, and show pictures that are within."""
    digest = base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
    return (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def data_block(name: str, content: Any) -> str:
    """Data for a script, which looks it up by its name; no text in it can end it."""
    text = json_text(content, separators=(",", ":")).replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{text}</script>'
