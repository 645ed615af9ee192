"""Previews of maps: colours, what they stand for, and the section of the report that shows them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from matest.estimation.parameter_map import ParameterMap, TexelStatus, map_file
from matest.estimation.result import Estimate
from matest.photographs.photometry import srgb
from matest.report.format import STATUSES, status_sentences
from matest.report.html import escape
from matest.scene import Surface

# Share of the pixels beyond either end of the colours: a few wild ones leave no colour to the others.
_BEYOND = 0.005
# Colours of what is known of a pixel, told apart by the colour-blind too (Okabe & Ito 2008), 8 bit.
_STATUS_COLOURS = {
    TexelStatus.DETERMINED: (0, 114, 178),
    TexelStatus.AT_BOUND: (240, 228, 66),
    TexelStatus.SHARED: (230, 159, 0),
    TexelStatus.UNSEEN: (90, 90, 90),
}
# Brightness where there is no value, 8 bit.
_GREY = 224
# Colours of a scale that the page draws between.
_STOPS = 9
# Span of a scale relative to its numbers, at least; and of one about 0.
_NARROWEST = 0.01
_LEAST = 1e-9
# Share of a step by which rounding may have moved a number.
_ROUNDING = 1e-6
# Numbers below a scale.
_TICKS = 3


@dataclass(frozen=True)
class Scale:
    """Values at the ends of the colours of a preview.

    Attributes:
        lower: darkest.
        upper: brightest.
        is_colour: whether three channels are the colours themselves, black at 0 and white at the upper end.
    """

    lower: float
    upper: float
    is_colour: bool = False

    def colours(self, values: np.ndarray) -> np.ndarray:
        """Of values [N, C], 8 bit [N, 3]; grey where there is none."""
        known = ~np.isnan(values).any(axis=1)
        if self.is_colour:
            shown = srgb(np.nan_to_num(values) / self.upper)
        else:
            level = (np.nan_to_num(values.mean(axis=1)) - self.lower) / (self.upper - self.lower)
            shown = _perceptual((255 * level.clip(0, 1)).round().astype(np.uint8))
        return np.where(known[:, None], shown, np.uint8(_GREY))


def value_scale(each: ParameterMap, unit: str) -> Scale:
    """The scale of the values: colours of an albedo in three channels, otherwise from the least to the largest."""
    values = each.value.double().numpy()
    if values.shape[1] == 3 and unit == "1":
        return Scale(0.0, _rounded_up(_quantile(values.max(axis=1), 1 - _BEYOND)), is_colour=True)
    lower, upper = (_quantile(values.mean(axis=1), share) for share in (_BEYOND, 1 - _BEYOND))
    # Of a map that is the same everywhere the scale is narrow, but not empty.
    span = max(upper - lower, _NARROWEST * abs(upper), _LEAST)
    step = 10.0 ** (math.floor(math.log10(span)) - 1)
    first, last = math.floor(lower / step + _ROUNDING), math.ceil(upper / step - _ROUNDING)
    return Scale(first * step, max(last, first + 1) * step)


def std_scale(each: ParameterMap) -> Scale:
    """The scale of the standard errors, from 0; of several channels their mean.

    It ends where an error is as large as the largest value: of a pixel with a larger one nothing is known.
    """
    largest, widest = (
        _rounded_up(_quantile(np.abs(part.double().numpy()).mean(axis=1), 1 - _BEYOND))
        for part in (each.value, each.std)
    )
    return Scale(0.0, min(largest, widest))


def value_picture(each: ParameterMap, surface: Surface, scale: Scale) -> np.ndarray:
    """The preview of the values [H, W, 3]."""
    return surface.image(scale.colours(each.value.double().numpy()), background=_GREY)


def std_picture(each: ParameterMap, surface: Surface) -> np.ndarray:
    """The preview of the standard errors [H, W, 3]."""
    return surface.image(std_scale(each).colours(each.std.double().numpy()), background=_GREY)


def known_picture(each: ParameterMap, surface: Surface) -> np.ndarray:
    """The preview of the status of every pixel [H, W, 3]: its codes are next to black to the eye."""
    colours = np.array([_STATUS_COLOURS[status] for status in TexelStatus], np.uint8)
    return surface.image(colours[each.status.numpy()], background=_GREY)


def pictures(estimate: Estimate, surface: Surface) -> Iterator[tuple[str, np.ndarray]]:
    """The previews of all maps, by their file in a result folder."""
    for name, each in estimate.maps.items():
        scale = value_scale(each, estimate.parameters[name].unit)
        yield picture_file(name), value_picture(each, surface, scale)
        yield picture_file(name, "std"), std_picture(each, surface)
        yield picture_file(name, "known"), known_picture(each, surface)
        if smooth := estimate.smooth_maps.get(name):
            yield picture_file(name, "smooth"), value_picture(smooth, surface, scale)
            yield picture_file(name, "smooth_std"), std_picture(smooth, surface)


def picture_file(name: str, kind: str = "") -> str:
    """The preview of a map in a result folder."""
    return map_file(name, kind).replace(".exr", ".png")


def maps_section(estimate: Estimate, previews: Mapping[str, str] | None) -> str:
    """Previews of maps and of their standard errors, and what share of them is known; empty where there are none.

    Args:
        estimate: with the maps.
        previews: by `picture_file` the small picture as a data URI; None: there are no pictures.
    """
    if not estimate.maps:
        return ""
    legend = "The numbers are in maps/NAME.exr and NAME_std.exr, the code of every pixel's status in "
    legend += "NAME_status.png: 0 not seen, 1 determined, 2 at a bound, 3 not told by its own photographs."
    if previews is not None:
        legend += " Grey is the background, and what no photograph shows."
    lines = [f"<p>{escape(line)}</p>" for line in (*status_sentences(estimate.maps), legend)]
    if previews is not None:
        rows = (_figures(name, estimate, previews) for name in estimate.maps)
        lines += [f"<style>{_style()}</style>", *(f'<div class="images">{"".join(row)}</div>' for row in rows)]
    return "\n".join(lines)


def _style() -> str:
    """The colours of the scales."""
    stops = _perceptual(np.linspace(0, 255, _STOPS).round().astype(np.uint8))
    colours = ", ".join("#" + bytes(stop).hex() for stop in stops.tolist())
    return f".scale {{ background: linear-gradient(to right, {colours}); }}"


def _figures(name: str, estimate: Estimate, previews: Mapping[str, str]) -> list[str]:
    """The figures of a map, of its standard errors, of what is known, and of the smoothed map, as HTML."""
    each, smooth, unit = estimate.maps[name], estimate.smooth_maps.get(name), estimate.parameters[name].unit
    of_channels = ", mean of the channels" if each.std.shape[1] > 1 else ""
    scale = value_scale(each, unit)
    shown = [
        ("", name + _exposure(scale), _key(scale, unit)),
        ("std", f"standard error of {name}{of_channels}{_beyond(each)}", _key(std_scale(each), unit)),
        ("known", f"what is known of {name}", _status_key(each)),
    ]
    if smooth is not None:
        shown += [
            ("smooth", f"{name}, smoothed{_exposure(scale)}", _key(scale, unit)),
            (
                "smooth_std",
                f"standard error of {name}, smoothed{of_channels}{_beyond(smooth)}",
                _key(std_scale(smooth), unit),
            ),
        ]
    return [
        f'<figure><img src="{previews[picture_file(name, kind)]}" alt="{escape(caption)}">'
        f"{key}<figcaption>{escape(caption)}</figcaption></figure>"
        for kind, caption, key in shown
    ]


def _status_key(each: ParameterMap) -> str:
    """What the colours of `known_picture` stand for, as HTML."""
    present = [status for status in STATUSES if each.shares[status]]
    swatches = (
        f'<span><i class="swatch" style="background: #{bytes(_STATUS_COLOURS[status]).hex()}"></i> '
        f"{STATUSES[status]}</span>"
        for status in present
    )
    return f'<figcaption class="legend">{"<br>".join(swatches)}</figcaption>'


def _beyond(each: ParameterMap) -> str:
    """That standard errors pass the end of their scale, as a clause; empty where hardly any does."""
    share = float((each.std.mean(dim=1) > std_scale(each).upper).double().mean())
    return f", larger at {share:.1%} of the pixels" if share > 2 * _BEYOND else ""


def _exposure(scale: Scale) -> str:
    """How bright colours are, as a clause; empty for a scale of numbers."""
    return f" as sRGB shows it, white at {scale.upper:.2g}" if scale.is_colour else ""


def _key(scale: Scale, unit: str) -> str:
    """The scale of a preview as HTML: colours with numbers below; empty where colours are what they are of."""
    if scale.is_colour:
        return ""
    values = np.linspace(scale.lower, scale.upper, _TICKS).tolist()
    digits = 2 - math.floor(math.log10(scale.upper - scale.lower))
    ticks = "".join(f"<span>{'<br>'.join(_tick(value, unit, digits))}</span>" for value in values)
    return f'<div class="scale"></div><figcaption class="ticks">{ticks}</figcaption>'


def _tick(value: float, unit: str, digits: int) -> list[str]:
    """The lines of a number of a scale, rounded, with its unit; of an angle with degrees below."""
    text = f"{round(value, digits):g}"
    if unit == "rad":
        return [f"{text} rad", f"{round(math.degrees(value), digits - 2):g}°"]
    return [text if unit == "1" else escape(f"{text} {unit}")]


def _perceptual(codes: np.ndarray) -> np.ndarray:
    """Colours [n, 3] of 8-bit levels [n], evenly brighter to the eye."""
    return cv2.applyColorMap(codes[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]


def _quantile(values: np.ndarray, share: float) -> float:
    """Of the values that are known; 1 where none is."""
    known = values[~np.isnan(values)]
    return float(np.quantile(known, share)) if len(known) else 1.0


def _rounded_up(value: float) -> float:
    """A number above 0 to two digits, not below what it was; 1 for 0."""
    step = 10.0 ** (math.floor(math.log10(max(value, _LEAST))) - 1)
    return math.ceil(value / step - _ROUNDING) * step if value > 0 else 1.0
