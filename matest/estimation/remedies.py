"""Causes of residuals in a sentence each for the person at the bench: what it is, how large, and the mend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from matest.estimation.diagnosis import Cause
from matest.inference.score_sums import BODY, LOBE
from matest.samples.uncertainty import labelled, whole

# χ² per value up to which residuals are explained, with room for noise that was estimated.
_EXPLAINED_CHI2 = 1.1
# Share of the misfit from which on a cause explains most of it.
_MOST = 0.5
# Causes that are no errors of the calibration.
_OF_MODEL = (LOBE, BODY)


class Remedy(NamedTuple):
    """What people can do about a cause.

    Attributes:
        what: the cause, with `{size}`.
        mend: at the bench, or in the capture.
        unit: of the size as people read it: "%", "°", "px", "".
        axes: along which errors add up to what people call their size.
    """

    what: str
    mend: str
    unit: str = "%"
    axes: int = 1


REMEDIES = {
    "direction": Remedy(
        "lights that stand {size} off what is stated", "measure them anew with a mirror sphere", "°", axes=2
    ),
    "rotation": Remedy("all lights turned together by {size}", "check the axes in which they are stated", "°", axes=3),
    "intensity": Remedy("lights whose strength is {size} off what is stated", "measure it with a grey card"),
    "exposure": Remedy("exposures that are {size} off what is stated", "state them as the camera recorded them"),
    "scale": Remedy("lights that are {size} off all together", "measure their strength with a grey card"),
    "ambient": Remedy(
        "light that is in every photograph, {size} of the key light",
        "subtract a photograph without the light, or state the light as ambient",
    ),
    "black": Remedy(
        "a black level that is off by {size} of full scale", "state it as encoding.black, or subtract a dark frame"
    ),
    "vignetting": Remedy("a loss of light of {size} at the corners of the images", "divide by a flat field"),
    "transfer": Remedy("an exponent of the transfer that is {size} off", "check encoding.transfer"),
    "curve": Remedy(
        "a transfer that is {size} of the way from the stated one to sRGB's (or from sRGB's to a power)",
        "check encoding.transfer, or try --transfer",
    ),
    "shift": Remedy("an object that lies {size} beside where it is stated to be", "fit its outline anew", "px", axes=2),
    "radius": Remedy("an outline whose radius is {size} off", "fit it anew", "px"),
    "tilt": Remedy("an object that is turned by {size}", "align the mesh anew", "°", axes=3),
    "normals": Remedy(
        "normals that are off by {size}, smoothly over the object", "check where the shape is from", "°", axes=2
    ),
    "normal_noise": Remedy(
        "normals that are off by {size} from pixel to pixel",
        "smooth them, or state --uncertainty normal_noise=VALUE",
        "°",
        axes=2,
    ),
    "albedo_field": Remedy(
        "an albedo that varies by {size} over the object", "estimate it at every pixel with --maps albedo"
    ),
    "albedo_noise": Remedy(
        "an albedo that varies by {size} from pixel to pixel",
        "estimate it at every pixel with --maps albedo, or state --uncertainty albedo_noise=VALUE",
    ),
    "blur": Remedy(
        "images that are blurred by {size}, of which a pixel's own area is 0.3 px",
        "focus, or let the object fill more pixels",
        "px",
    ),
    LOBE: Remedy("a lobe that the model does not have", "try --model auto, or a sum of models", ""),
    BODY: Remedy("a diffuse body that scatters by another law", "try --model auto, or another body", ""),
}


@dataclass(frozen=True)
class Diagnosis:
    """A cause of residuals, as a result tells it.

    Attributes:
        cause: family of errors of the calibration, or "lobe", "body": of the model.
        size: of the only number that is off, or the rms of the errors as a whole; None: of the model.
        std: standard error of the only number; None: there are several.
        unit: "relative", "rad", "px".
        chi2_before, chi2_after: per value, without and with it.
        message: what it is and the mend, as a sentence.
        others: causes that would explain the same as well and are as simple.
    """

    cause: str
    size: float | None
    std: float | None
    unit: str
    chi2_before: float
    chi2_after: float
    message: str
    others: list[str]


def of_pixel_area(cause: Cause) -> str:
    """A sentence on what averaging over a pixel does."""
    how = "which was refined" if cause.refined else "which error bars hold; --refine blur allows for it"
    return (
        f"Pixels average over their area ({_spoken(cause)}), while the model is shaded at their centres: that shows in "
        f"these images, {how}. It is less where the object fills more pixels."
    )


def diagnoses(causes: Sequence[Cause]) -> list[Diagnosis]:
    """The causes of residuals, the one that explains most first."""
    return [_diagnosis(cause, causes[0]) for cause in causes]


def _diagnosis(cause: Cause, first: Cause) -> Diagnosis:
    size, std = _size(cause)
    return Diagnosis(
        cause=cause.family,
        size=size,
        std=std,
        unit={"1": "relative", "px²": "px"}.get(cause.unit, cause.unit),
        chi2_before=cause.chi2_before,
        chi2_after=cause.chi2_after,
        message=_message(cause, first),
        others=[*cause.rivals],
    )


def _size(cause: Cause) -> tuple[float | None, float | None]:
    """Size and standard error; of a blur, whose unknown is a variance, those of its width."""
    if cause.family != "blur" or cause.size is None or cause.size <= 0:
        return cause.size, cause.std
    width = math.sqrt(cause.size)
    return width, None if cause.std is None else cause.std / (2 * width)


def _message(cause: Cause, first: Cause) -> str:
    """A sentence on a cause; `first` is the one that explains most."""
    remedy, explained = REMEDIES[cause.family], cause.chi2_after <= _EXPLAINED_CHI2
    most = cause.gain > _MOST * (cause.chi2_before - 1)
    share = "" if explained else "mostly " if most else "partly "
    verb = "were" if cause.refined else "are"
    opening = f"The residuals {verb} {share}due to" if cause is first else f"Beside that they {verb} due to"
    option = "" if cause.refined or not cause.refinable else f", or --refine {whole(cause.family)}"
    mend = f"{'refined; better still ' if cause.refined else ''}{remedy.mend}{option}"
    return (
        f"{opening} {remedy.what.format(size=_spoken(cause))} (χ² per value {cause.chi2_before:.3g}, with it "
        f"{cause.chi2_after:.3g}): {mend}.{_rivals(cause)}"
    )


def _rivals(cause: Cause) -> str:
    """A sentence on what would explain the same; empty where there is nothing."""
    errors = ", ".join(labelled(name) for name in cause.rivals if name not in _OF_MODEL)
    others = [f"errors of {errors}"] if errors else []
    others += [f"another {name}" for name in cause.rivals if name in _OF_MODEL]
    return f" It could as well be {' or '.join(others)}." if others else ""


def _spoken(cause: Cause) -> str:
    """How large the errors of a cause are, in the unit that people read."""
    (size, std), unit = _size(cause), REMEDIES[cause.family].unit
    if size is None:
        return ""
    scale = {"%": 100.0, "°": math.degrees(1.0)}.get(unit, 1.0)
    scale *= math.sqrt(REMEDIES[cause.family].axes)
    number = f"{scale * abs(size):.2g}" if std is None else _with_error(scale * abs(size), scale * std)
    return number + ("" if unit == "°" else " ") + unit


def _with_error(value: float, std: float) -> str:
    digits = max(-math.floor(math.log10(std)), 0) if std > 0 else 2
    return f"{value:.{digits}f} ± {std:.{digits}f}"
