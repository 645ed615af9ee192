"""Correlations of the estimates, drawn."""

from __future__ import annotations

from collections.abc import Sequence

from matest.estimation.result import Estimate
from matest.report.html import escape

# Side of a cell, in units of the drawing.
_CELL = 44
# Correlation from which on the colour of a square is too deep for numbers in the colour of the text.
_DEEP = 0.85
# Width of a letter likewise, at most: names are left of the cells and, on end, above them.
_LETTER = 7
# Names that a drawing has place for.
_MAX_NAMES = 24
# Names with numbers in their cells.
_MAX_NUMBERS = 12
# Letters of a name that fit in the margin.
_LETTERS = 18
# Correlation from which on two estimates are said to hang together.
_CLOSE = 0.9


def correlations(estimate: Estimate) -> str:
    """A drawing, and the closest pair in words; empty with fewer than two names."""
    names, matrix = estimate.label_names, estimate.correlation
    if len(names) < 2:
        return ""
    said = _closest(names, matrix)
    if len(names) > _MAX_NAMES:
        return f"<p>{escape(said)} The matrix of all {len(names)} is in result.json.</p>"
    return f"<p>{escape(said)}</p>\n{_drawing(names, matrix)}"


def _closest(names: Sequence[str], matrix: Sequence[Sequence[float]]) -> str:
    """The pair that hangs together most, and how many do."""
    pairs = [(abs(matrix[i][j]), i, j) for i in range(len(names)) for j in range(i)]
    _, i, j = max(pairs)
    close = sum(pair[0] > _CLOSE for pair in pairs)
    sentence = f"Errors of {names[j]} and {names[i]} hang together most: correlation {matrix[i][j]:.2f}."
    if not close:
        return sentence
    how = "in the same direction" if matrix[i][j] > 0 else "in opposite directions"
    return (
        f"{sentence} Beyond {_CLOSE}, where {close} of {len(pairs)} pairs are, the samples hardly tell two apart: both "
        f"may be off, {how} for this pair."
    )


def _drawing(names: Sequence[str], matrix: Sequence[Sequence[float]]) -> str:
    labels = [name if len(name) <= _LETTERS else f"…{name[1 - _LETTERS :]}" for name in names]
    margin = 12 + _LETTER * max(map(len, labels))
    side = margin + _CELL * len(names)
    parts = []
    for i, label in enumerate(map(escape, labels)):
        middle = margin + _CELL * (i + 0.5)
        parts.append(f'<text x="{margin - 6}" y="{middle + 4}" text-anchor="end">{label}</text>')
        parts.append(f'<text transform="translate({middle + 4} {margin - 6}) rotate(-90)">{label}</text>')
        for j, value in enumerate(matrix[i]):
            x, y = margin + _CELL * j, margin + _CELL * i
            parts.append(_cell(x, y, value, number=i != j and len(names) <= _MAX_NUMBERS))
    return (
        f'<svg class="heat" viewBox="0 0 {side} {side}" width="{side}" role="img" '
        f'aria-label="correlations of the estimates">{"".join(parts)}</svg>'
    )


def _cell(x: float, y: float, value: float, *, number: bool) -> str:
    """The square of a correlation with its corner at x, y."""
    kind = "plus" if value >= 0 else "minus"
    square = (
        f'<rect class="cell {kind}" x="{x}" y="{y}" width="{_CELL}" height="{_CELL}" '
        f'fill-opacity="{0.85 * min(abs(value), 1):.2f}"/>'
    )
    if not number:
        return square
    place = f'x="{x + _CELL / 2}" y="{y + _CELL / 2 + 4}"'
    tone = ' class="bright"' if abs(value) > _DEEP else ""
    return f'{square}<text{tone} {place} text-anchor="middle">{value:.2f}</text>'
