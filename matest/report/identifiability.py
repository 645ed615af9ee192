"""What a check found, for the terminal."""

from __future__ import annotations

import math

from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Table
from rich.text import Text

from matest.identifiability import Check, LightAdvice, Prediction
from matest.inference.quantities import Number

_STATUS_STYLE = {"determined": "green", "weak": "yellow", "held": "yellow", "not determined": "red"}


def check_report(check: Check) -> Group:
    """Predicted error bars, reasons, the light that would help most, and what all this rests on."""
    several = bool(check.levels)
    table = Table(box=SIMPLE_HEAD, title=f"{check.capture}: {check.model}", title_justify="left")
    # Values of several channels, and ranges, go to a second line where the table would not fit.
    table.add_column("parameter", no_wrap=True)
    table.add_column("assumed")
    table.add_column("standard error", no_wrap=True)
    table.add_column("relative (range)" if several else "relative", min_width=8)
    table.add_column("status", no_wrap=True)
    component = ""
    for name, prediction in check.parameters.items():
        # Parameters of a sum stand under the name of their model.
        owner, dot, short = name.rpartition(".")
        if dot and owner != component:
            component = owner
            table.add_row(Text(owner, style="bold"))
        cells = (f"  {short}" if dot else name, _value(prediction), _error(prediction), _relative(prediction))
        table.add_row(*cells, Text(prediction.status, style=_STATUS_STYLE.get(prediction.status, "")))
    parts: list[object] = [table]
    parts += [
        Text(f"{name} ({prediction.status}): {prediction.reason}.", style=_STATUS_STYLE.get(prediction.status, ""))
        for name, prediction in check.parameters.items()
        if prediction.reason
    ]
    parts.append(_advice(check.light))
    if check.light is not None:
        parts.append(_with_light(check, check.light))
        if check.light.frees:
            parts.append(_freed(check.light))
    if several:
        spans = [f"{name} {low:.3g} to {high:.3g}" for name, (low, *_, high) in check.levels.items()]
        parts.append(Text(f"Range: over {', '.join(spans)}; --at NAME=VALUE predicts for another value."))
    noise = check.noise
    images = f"{check.images} image{'s' * (check.images != 1)}"
    parts.append(
        Text(
            f"{check.samples:,} samples of {images}; noise {noise['source']}: "
            f"read {noise['read']:.3g}, gain {noise['gain']:.3g} of full scale."
        )
    )
    parts += [Text(f"Note: {warning}", style="yellow") for warning in check.warnings]
    return Group(*parts)  # type: ignore[arg-type]


def _with_light(check: Check, light: LightAdvice) -> Table:
    table = Table(box=SIMPLE_HEAD)
    for column in ("parameter", "error now", "with it", "smaller by"):
        table.add_column(column, no_wrap=True)
    for name, std in light.std.items():
        gain = light.gain[name]
        now = check.parameters[name]
        change = "becomes determined" if name in light.resolves else "-" if gain is None else f"{gain:.3g} ×"
        table.add_row(name, _error(now), _error(Prediction(now.value, std, None, None, now.unit, "")), change)
    return table


def _freed(light: LightAdvice) -> Text:
    """What is estimated with the light that is taken for granted now."""
    errors = [f"{name} ± {std:.2g}" for name, number in light.freed.items() if (std := _largest(number)) is not None]
    fixes = " ".join(f"--fix {name}=VALUE" for name in light.frees)
    return Text(
        f"With it {' and '.join(light.frees)} will be estimated too, no longer taken for granted: {', '.join(errors)}. "
        f"{fixes} keeps the errors of the table.",
        style="yellow",
    )


def _advice(light: LightAdvice | None) -> Text:
    if light is None:
        return Text("No further distant light would lower the largest relative error.")
    x, y, z = (value + 0.0 for value in light.direction)
    where = "from the camera itself"
    if light.from_camera > math.radians(0.5):
        where = (
            f"{math.degrees(light.from_camera):.0f}° off the camera, "
            f"{math.degrees(light.azimuth) % 360:.0f}° counterclockwise from the image's right"
        )
    before, after = (_percent(value) for value in light.worst)
    largest = f": largest relative error {before} -> {after}" if not light.resolves else ""
    return Text(f"Next light: direction = [{x:.3f}, {y:.3f}, {z:.3f}], {where}{largest}.")


def _value(prediction: Prediction) -> str:
    unit = "" if prediction.unit == "1" else f" {prediction.unit}"
    if _largest(prediction.value) is None:
        return "-"
    values = prediction.value if isinstance(prediction.value, list) else [prediction.value]
    text = ", ".join(f"{value:.3g}" for value in dict.fromkeys(values)) + unit
    return text + f"\n{math.degrees(values[0] or 0):.1f}°" if prediction.unit == "rad" else text


def _error(prediction: Prediction) -> str:
    std = _largest(prediction.std)
    if std is None:
        return "-"
    if prediction.unit == "rad":
        return f"± {std:.2g} rad\n± {math.degrees(std):.2g}°"
    return f"± {std:.2g}"


def _largest(number: Number) -> float | None:
    """Of the channels, the largest; None where any has none."""
    values = number if isinstance(number, list) else [number]
    known = [value for value in values if value is not None]
    return max(known) if known and len(known) == len(values) else None


def _relative(prediction: Prediction) -> str:
    if prediction.range is None:
        return _percent(prediction.relative)
    low, high = (_percent(value) for value in prediction.range)
    return f"{_percent(prediction.relative)} ({low} to {high})"


def _percent(value: float | None) -> str:
    if value is None:
        return "-"
    if value > 100:
        return "> 10000%"
    return f"{100 * value:.2g}%" if value < 0.995 else f"{100 * value:.0f}%"
