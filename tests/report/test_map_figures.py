"""Previews of maps: their colours stand for the numbers of their scales."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.photographs.photometry import srgb
from matest.report.format import status_sentences
from matest.report.map_figures import (
    Scale,
    known_picture,
    maps_section,
    pictures,
    std_picture,
    std_scale,
    value_picture,
    value_scale,
)
from tests.captures import sphere_surface
from tests.estimates import clay
from tests.report.pages import read, words

SURFACE = sphere_surface(32)
COUNT = len(SURFACE)
GREY = 224
# Previews as the page has them, by file.
KINDS = ("", "_std", "_known", "_smooth", "_smooth_std")
SHOWN = {f"maps/{name}{kind}.png": f"data:{name}{kind}" for name in ("albedo", "sigma") for kind in KINDS}


def a_map(name: str, values: torch.Tensor, std: float = 0.01) -> ParameterMap:
    status = torch.full((COUNT,), int(TexelStatus.DETERMINED), dtype=torch.uint8)
    status[values.isnan().any(dim=1)] = TexelStatus.UNSEEN
    return ParameterMap(name, values, torch.full_like(values, std), status)


def coloured() -> ParameterMap:
    return a_map("albedo", torch.linspace(0.1, 0.4, COUNT)[:, None] * torch.tensor([1.0, 0.5, 0.25]))


def rough() -> ParameterMap:
    values = torch.linspace(0.2, 0.5, COUNT)[:, None].clone()
    values[:5] = math.nan
    return a_map("sigma", values)


def test_three_channels_of_albedo_are_colours_and_white_is_stated() -> None:
    scale = value_scale(coloured(), "1")
    assert scale == Scale(0.0, pytest.approx(0.4), is_colour=True)
    on_object = value_picture(coloured(), SURFACE, scale).reshape(-1, 3)[SURFACE.pixels]
    np.testing.assert_array_equal(on_object, srgb(coloured().value.double().numpy() / scale.upper))
    assert (
        "albedo as sRGB shows it, white at 0.4 " in words(maps_section(clay(maps={"albedo": coloured()}), SHOWN)) + " "
    )


@pytest.mark.parametrize(("each", "unit"), [(rough(), "rad"), (a_map("albedo", rough().value), "1")])
def test_one_channel_has_a_scale_that_holds_its_values(each: ParameterMap, unit: str) -> None:
    scale = value_scale(each, unit)
    assert not scale.is_colour
    assert scale.lower <= float(each.value.nan_to_num(1).quantile(0.01))
    assert scale.upper >= float(each.value.nan_to_num(0).quantile(0.99))
    assert scale.upper - scale.lower < 0.35


def test_colours_get_brighter_with_the_value_and_grey_is_no_value() -> None:
    picture = value_picture(rough(), SURFACE, value_scale(rough(), "rad"))
    on_object = picture.reshape(-1, 3)[SURFACE.pixels]
    assert (on_object[:5] == GREY).all()
    assert (picture[~SURFACE.mask] == GREY).all()
    lightness = cv2.cvtColor(on_object[None, 5:], cv2.COLOR_RGB2LAB)[0, :, 0].astype(int)
    assert (np.diff(lightness) >= -1).all()
    assert lightness[-1] - lightness[0] > 150


def test_the_page_has_numbers_with_unit_and_degrees_below_a_scale() -> None:
    section = maps_section(clay(maps={"sigma": rough()}), SHOWN)
    text = words(section)
    assert "0.2 rad 11.5° 0.35 rad 20.1° 0.5 rad 28.6° sigma" in text
    assert "standard error of sigma" in text
    sources = [picture["src"] for picture in read(section).pictures]
    assert sources == ["data:sigma", "data:sigma_std", "data:sigma_known"]
    assert section.count('class="scale"') == 2


def test_a_smoothed_map_has_the_colours_of_the_map_itself() -> None:
    each, smooth = rough(), replace(rough(), value=rough().value * 0.5 + 0.2, std=rough().std / 3)
    estimate = clay(maps={"sigma": each}, smooth_maps={"sigma": smooth})
    shown = dict(pictures(estimate, SURFACE))
    expected = value_scale(each, "rad").colours(smooth.value.double().numpy())
    np.testing.assert_array_equal(shown["maps/sigma_smooth.png"].reshape(-1, 3)[SURFACE.pixels], expected)
    section = maps_section(estimate, SHOWN)
    assert {picture["src"] for picture in read(section).pictures} == {SHOWN[file] for file in shown}
    assert "sigma, smoothed" in words(section)


def test_what_is_known_is_seen_in_colours_with_a_legend() -> None:
    each = rough()
    each.status[5:50] = TexelStatus.SHARED
    picture = known_picture(each, SURFACE).reshape(-1, 3)[SURFACE.pixels].astype(int)
    colours = np.unique(picture, axis=0)
    assert len(colours) == 3
    assert min(np.abs(a - b).max() for a in colours for b in colours if (a != b).any()) > 60
    section = maps_section(clay(maps={"sigma": each}), SHOWN)
    legend = words(section)
    for status in ("determined", "not told by their own photographs", "not seen"):
        assert status in legend
    for colour in colours:
        assert f"#{bytes(colour.tolist()).hex()}" in section


def test_standard_errors_begin_at_nothing() -> None:
    assert std_scale(rough()) == Scale(0.0, pytest.approx(0.01))
    lost = rough()
    lost.std[:50] = 500.0
    # Errors far above all values say no more than that nothing is known there.
    assert std_scale(lost) == Scale(0.0, pytest.approx(0.5))
    assert (std_picture(rough(), SURFACE)[~SURFACE.mask] == GREY).all()


def test_a_map_that_is_the_same_everywhere_has_a_scale() -> None:
    for value in (0.5, 0.0):
        each = a_map("sigma", torch.full((COUNT, 1), value), std=0.0)
        scale = value_scale(each, "rad")
        assert scale.lower <= value < scale.upper
        assert std_scale(each).upper > 0
        assert "rad" in maps_section(clay(maps={"sigma": each}), SHOWN)


def test_a_map_of_which_nothing_is_seen_is_grey() -> None:
    each = a_map("sigma", torch.full((COUNT, 1), math.nan))
    assert (value_picture(each, SURFACE, value_scale(each, "rad")) == GREY).all()
    assert status_sentences({"sigma": each}) == ["Map of sigma: not seen at 100.0% of the object's pixels."]


def test_a_sentence_says_what_share_of_the_pixels_is_known() -> None:
    status = torch.ones(10_000, dtype=torch.uint8)
    status[:500], status[500:700], status[700] = TexelStatus.UNSEEN, TexelStatus.SHARED, TexelStatus.AT_BOUND
    values = torch.full((10_000, 1), 0.5)
    each = ParameterMap("albedo", values, values, status)
    assert sum(each.shares.values()) == pytest.approx(1)
    assert status_sentences({"albedo": each}) == [
        "Map of albedo: determined at 93.0% of the object's pixels, at a bound at few, not told by their own "
        "photographs at 2.0%, not seen at 5.0%."
    ]
    shares = clay(maps={"albedo": each}).to_dict()["maps"]["albedo"]["shares"]
    assert shares == {"unseen": 0.05, "determined": 0.9299, "at bound": 0.0001, "shared": 0.02}


def test_without_previews_the_sentences_remain() -> None:
    section = maps_section(clay(maps={"sigma": rough()}), None)
    assert read(section).pictures == []
    assert "determined at" in section
    assert "Grey" not in section
    assert maps_section(clay(), {}) == ""
