"""A check as the terminal shows it."""

from __future__ import annotations

import math

from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from matest.identifiability import CalibrationError, CalibrationLimit, Check, LightAdvice, Prediction
from matest.inference.quantities import Number
from matest.report.format import percent, short
from matest.report.map_forecast import maps_report
from matest.report.tables import add_parameters, in_colour, plain_table
from matest.samples.uncertainty import labelled

# Parameters that the table of the calibration has columns for: more do not fit beside each other.
_MAX_COLUMNS = 5
# Columns of the longest name of a family: what stands in brackets behind it goes to a second line where it must.
_NAME_WIDTH = 12
# Relative errors that are not worth a cell.
_NOTHING = 1e-4


def check_report(check: Check) -> Group:
    """How the files were read, predicted error bars and why, errors of the calibration, the best light, the basis."""
    reasons = [
        in_colour(f"{name} ({prediction.status}): {prediction.reason}.", prediction.status)
        for name, prediction in check.parameters.items()
        if prediction.reason
    ]
    warnings = [Text(f"Note: {warning}", style="yellow") for warning in check.warnings]
    limits = [Text(_limit(limit)) for limit in check.limits]
    return Group(
        *([understanding_table(check.capture, check.understood)] if check.understood else []),
        _predictions(check),
        *reasons,
        *limits,
        *_calibration(check),
        *(maps_report(check.maps) if check.maps is not None else []),
        *_light(check),
        *_basis(check),
        *warnings,
    )


def understanding_table(capture: str, understood: dict[str, str]) -> Table:
    """How the files of a capture were read, a line for each convention."""
    table = plain_table(Column("what", no_wrap=True), "as understood", title=f"{capture}: how it is read")
    for topic, words in understood.items():
        table.add_row(topic, words)
    return table


def _predictions(check: Check) -> Table:
    """The predicted error bars."""
    several = any(isinstance(prediction.value, list) for prediction in check.parameters.values())
    coloured = "; errors are those of the least known channel" if several else ""
    # Values of several channels, and ranges, go to a second line where the table would not fit.
    table = plain_table(
        Column("parameter", no_wrap=True),
        "assumed",
        Column("standard error", no_wrap=True),
        Column("relative (range)" if check.levels else "relative", min_width=8),
        Column("status", no_wrap=True),
        title=f"{check.capture}: {check.model}{coloured}",
    )

    def rows_of(label: str, prediction: Prediction) -> list[tuple[str, ...]]:
        error = _error(_least_known(prediction.value, prediction.std), prediction.unit)
        return [(label, _value(prediction), error, _relative(prediction), prediction.status)]

    add_parameters(table, check.parameters, rows_of)
    return table


def _limit(limit: CalibrationLimit) -> str:
    """What limits a parameter, and what knowing it better would bring."""
    size, better = (_as_stated(number, limit.unit) for number in (limit.size, limit.better))
    return (
        f"{limit.parameter} ± {percent(limit.relative)}, of which {percent(limit.part)} from "
        f"{labelled(limit.family)} ({size}): known to {better}, ± {percent(limit.then)}."
    )


def _as_stated(size: float, unit: str) -> str:
    """A standard deviation as `--uncertainty` takes it."""
    return f"{size:.3g}" + ("" if unit == "1" else f" {unit}")


def _calibration(check: Check) -> list[Text | Table]:
    """What errors of each kind do to each parameter, the largest effect first."""
    errors = check.calibration
    most = {name: max(error.relative[name] for error in errors.values()) for name in _affected(check)}
    if not most:
        return []
    shown = sorted(most, key=lambda name: -most[name])[:_MAX_COLUMNS]
    names = {name: short(name, most) for name in most if name in shown}
    table = plain_table(
        Column("error of", min_width=_NAME_WIDTH),
        Column("size", no_wrap=True),
        *(Column(name, justify="right", overflow="fold") for name in names.values()),
        title="What errors of the calibration would do",
    )
    for family, error in errors.items():
        cells = ("-" if error.relative[name] < _NOTHING else percent(error.relative[name]) for name in names)
        table.add_row(labelled(family), _size(error) + " *" * error.stated, *cells)
    family, error = next(iter(errors.items()))
    worst = max(error.relative, key=lambda name: error.relative[name])
    move = f"{labelled(family)} matters most: {_size(error)} moves {worst} by {percent(error.relative[worst])}."
    legend = " * as stated; the predicted errors hold it." if any(error.stated for error in errors.values()) else ""
    rest = f" {len(most) - len(names)} more parameters: --json." if len(most) > len(names) else ""
    return [table, Text(move + legend + rest)]


def _affected(check: Check) -> list[str]:
    """The determined parameters, on which errors of the calibration have an effect."""
    return list(dict.fromkeys(name for error in check.calibration.values() for name in error.relative))


def _size(error: CalibrationError) -> str:
    """One standard deviation of errors, as the table gives it."""
    if error.unit == "rad":
        return f"{math.degrees(error.size):.2g}°"
    if error.unit == "1":
        return f"{100 * error.size:.2g}%"
    return f"{math.sqrt(error.size) if error.unit == 'px²' else error.size:.2g} px"


def _basis(check: Check) -> list[Text]:
    """The values, samples and noise that the prediction rests on."""
    noise, images = check.noise, f"{check.images} image{'s' * (check.images != 1)}"
    samples = Text(
        f"{check.samples:,} samples of {images}; noise {noise['source']}: "
        f"read {noise['read']:.3g}, gain {noise['gain']:.3g} of full scale."
    )
    if not check.levels:
        return [samples]
    spans = [f"{name} {low:.3g} to {high:.3g}" for name, (low, *_, high) in check.levels.items()]
    return [Text(f"Range: over {', '.join(spans)}; --at NAME=VALUE predicts for another value."), samples]


def _light(check: Check) -> list[Text | Table]:
    """The light that would help most, and what it brings."""
    light = check.light
    if light is None:
        return [Text("No further distant light would lower the largest relative error.")]
    brings: list[Text | Table] = [_direction(light), _with_light(check, light)]
    if any(error.stated for error in check.calibration.values()):
        brings.insert(1, Text("Its errors are those of the noise alone:"))
    return [*brings, _freed(check, light)] if light.frees else brings


def _with_light(check: Check, light: LightAdvice) -> Table:
    """Error bars by the noise without and with the light."""
    table = plain_table(*(Column(name, no_wrap=True) for name in ("parameter", "error now", "with it", "smaller by")))
    for name, std in light.std.items():
        prediction = check.parameters[name]
        now, then = (_least_known(prediction.value, number) for number in (prediction.noise_std, std))
        change = f"{now / then:.3g} ×" if now and then else "-"
        if name in light.resolves:
            change = "becomes determined"
        table.add_row(name, _error(now, prediction.unit), _error(then, prediction.unit), change)
    return table


def _freed(check: Check, light: LightAdvice) -> Text:
    """The parameters that the light lets `estimate` free."""
    values = {name: prediction.value for name, prediction in check.parameters.items()}
    stds = {name: _least_known(values.get(name), number) for name, number in light.freed.items()}
    errors = [f"{name} ± {std:.2g}" for name, std in stds.items() if std is not None]
    fixes = " ".join(f"--fix {name}=VALUE" for name in light.frees)
    return Text(
        f"With it {' and '.join(light.frees)} will be estimated too, no longer taken for granted: {', '.join(errors)}. "
        f"{fixes} keeps the errors of the table.",
        style="yellow",
    )


def _direction(light: LightAdvice) -> Text:
    """Where the light should stand."""
    x, y, z = (value + 0.0 for value in light.direction)
    place = "from the camera itself"
    if light.from_camera > math.radians(0.5):
        place = (
            f"{math.degrees(light.from_camera):.0f}° off the camera, "
            f"{math.degrees(light.azimuth) % 360:.0f}° counterclockwise from the image's right"
        )
    before, after = (percent(value) for value in light.worst)
    largest = f": largest relative error {before} -> {after}" if not light.resolves else ""
    return Text(f"Next light: direction = [{x:.3f}, {y:.3f}, {z:.3f}], {place}{largest}.")


def _value(prediction: Prediction) -> str:
    """The value that a prediction is for, each different one of its channels once."""
    unit = "" if prediction.unit == "1" else f" {prediction.unit}"
    values = prediction.value if isinstance(prediction.value, list) else [prediction.value]
    if None in values:
        return "-"
    text = ", ".join(f"{value:.3g}" for value in dict.fromkeys(values)) + unit
    return text + f"\n{math.degrees(values[0] or 0):.1f}°" if prediction.unit == "rad" else text


def _least_known(value: Number, std: Number) -> float | None:
    """The standard error of the channel whose relative error is the largest; None where a channel has no number."""
    errors = std if isinstance(std, list) else [std]
    values = value if isinstance(value, list) else [value] * len(errors)
    known = [(one, error) for one, error in zip(values, errors, strict=True) if one is not None and error is not None]
    if len(known) < len(errors):
        return None
    return max(known, key=lambda pair: pair[1] / max(abs(pair[0]), 1e-300))[1]


def _error(std: float | None, unit: str) -> str:
    """A standard error with its unit."""
    if std is None:
        return "-"
    if unit == "rad":
        return f"± {std:.2g} rad\n± {math.degrees(std):.2g}°"
    return f"± {std:.2g}"


def _relative(prediction: Prediction) -> str:
    if prediction.range is None:
        return percent(prediction.relative)
    low, high = (percent(value) for value in prediction.range)
    return f"{percent(prediction.relative)} ({low} to {high})"
