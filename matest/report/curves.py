"""Curves as pictures within a page: SVG by hand, which a report draws in no time and which follows its colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matest.report.html import escape

# Of the drawing and of the frame within, in units of its own.
_WIDTH, _HEIGHT = 340, 230
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 330, 10, 188
# Ticks of the axis upward, at most.
_MAX_TICKS = 6


@dataclass(frozen=True)
class Curve:
    """A line of a drawing.

    Attributes:
        label: for the legend.
        values: upward.
        colour: of the line, as CSS has it.
        dashed: whether it is.
    """

    label: str
    values: Sequence[float]
    colour: str
    dashed: bool = False


def drawing(x: Sequence[float], curves: Sequence[Curve], across: Sequence[float], x_title: str, y_title: str) -> str:
    """Some curves over the same places, with a line at 0.

    Args:
        x: places of the values, ascending.
        curves: to draw.
        across: ticks of the axis across, ascending; the first and the last are its ends.
        x_title: of the axis across.
        y_title: of the axis upward.
    """
    every = [value for curve in curves for value in curve.values]
    ticks = _ticks(min(0.0, *every), max(0.0, *every))
    right = {tick: _LEFT + (_RIGHT - _LEFT) * (tick - across[0]) / (across[-1] - across[0]) for tick in [*across, *x]}
    up = {y: _BOTTOM - (_BOTTOM - _TOP) * (y - ticks[0]) / (ticks[-1] - ticks[0]) for y in [*ticks, *every]}
    grid = [_line(_LEFT, up[tick], _RIGHT, up[tick], 0.6 if tick == 0 else 0.15) for tick in ticks]
    names = [_text(_LEFT - 5, up[tick] + 4, f"{tick:g}", "end") for tick in ticks]
    names += [_text(right[tick], _BOTTOM + 15, f"{tick:g}", "middle") for tick in across]
    names.append(_text((_LEFT + _RIGHT) / 2, _HEIGHT - 10, x_title, "middle"))
    names.append(
        f'<g transform="translate(11 {(_TOP + _BOTTOM) / 2:g}) rotate(-90)">{_text(0, 0, y_title, "middle")}</g>'
    )
    lines = [
        _curve(curve, [(right[place], up[y]) for place, y in zip(x, curve.values, strict=True)]) for curve in curves
    ]
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{escape(y_title)} by {escape(x_title)}" '
        f'font-size="11" fill="currentColor">{"".join([*grid, *names, *lines])}</svg>'
    )


def legend(curves: Sequence[Curve]) -> str:
    """What the curves are, as a line of HTML."""
    return ", ".join(
        f'<span style="color: {curve.colour}">{"╌╌" if curve.dashed else "──"}</span> {escape(curve.label)}'
        for curve in curves
    )


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers from one below or at `low` to one above or at `high`."""
    span = (high - low) or 1.0
    power = 10.0 ** math.floor(math.log10(span / _MAX_TICKS))
    step = next(factor * power for factor in (1, 2, 5, 10, 20) if span <= (_MAX_TICKS - 1) * factor * power)
    first, last = math.floor(low / step), max(math.ceil(high / step), math.floor(low / step) + 1)
    return [round(number * step, 12) for number in range(first, last + 1)]


def _line(x1: float, y1: float, x2: float, y2: float, strength: float) -> str:
    return f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="currentColor" stroke-opacity="{strength}"/>'


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _curve(curve: Curve, points: Sequence[tuple[float, float]]) -> str:
    place = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dashes = ' stroke-dasharray="4 3"' if curve.dashed else ""
    return f'<polyline points="{place}" fill="none" stroke="{curve.colour}" stroke-width="1.8"{dashes}/>'
