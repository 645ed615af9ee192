"""Numbers as people read them: a value with as many digits as its error bar allows, angles with degrees beside."""

from __future__ import annotations

import math

from matest.result import ParameterEstimate


def measured(value: float | None, std: float | None) -> str:
    """`0.5236 ± 0.0012`; the value alone without an error bar; `-` without a value."""
    if value is None:
        return "-"
    if std is None or not math.isfinite(std):
        return f"{value:.4g}"
    if std == 0:
        return f"{value:.6g} ± 0"
    digits = min(max(1 - math.floor(math.log10(std)), 0), 9)
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def rows(name: str, parameter: ParameterEstimate, channels: tuple[str, ...]) -> list[tuple[str, str, str, str]]:
    """Table rows (name, value ± error, 95 % interval, status) of a parameter: one, or one per channel."""
    value, std, interval = parameter.value, parameter.std, parameter.interval95
    if not isinstance(value, list):
        single = std if isinstance(std, float) else None
        return [(name, *_cells(value, single, interval, parameter.unit), parameter.status)]
    stds = std if isinstance(std, list) else [None] * len(value)
    intervals = interval or [None] * len(value)
    return [
        (f"{name} {channel}", *_cells(one, error, span, parameter.unit), parameter.status)
        for channel, one, error, span in zip(channels, value, stds, intervals, strict=False)
    ]


def chi2(value: float) -> str:
    """χ² per value: two decimals near 1, three digits far from it."""
    return f"{value:.2f}" if value < 100 else f"{value:.3g}"


def channel_names(count: int) -> tuple[str, ...]:
    return ("R", "G", "B") if count == 3 else tuple(str(k) for k in range(count))


def _cells(value: float | None, std: float | None, interval: list[float] | None, unit: str) -> tuple[str, str]:
    if unit == "rad":
        degrees = [None if v is None else math.degrees(v) for v in (value, std)]
        text = "-" if value is None else f"{measured(value, std)} rad\n{measured(*degrees)} degrees"
        span = "-" if interval is None else f"{math.degrees(interval[0]):.4g}° to {math.degrees(interval[1]):.4g}°"
        return text, span
    suffix = "" if unit == "1" or value is None else f" {unit}"
    span = "-" if interval is None else f"{interval[0]:.4g} to {interval[1]:.4g}"
    return measured(value, std) + suffix, span
