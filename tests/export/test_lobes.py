"""Materials as sums of lobes."""

from __future__ import annotations

import math

import pytest
import torch

from matest.brdf import (
    BlinnPhong,
    Brdf,
    CookTorrance,
    HeTorrance,
    Lambert,
    LiTorrance,
    OrenNayar,
    TorranceSparrow,
    Ward,
    preset,
)
from matest.export.lobes import index_of, is_matte, lobes_of


def test_what_reflects_nothing_is_no_lobe() -> None:
    lobes = lobes_of(OrenNayar(0.5, 0.4) + CookTorrance(0.0, 0.5, 0.2))
    assert lobes is not None
    assert [lobe.kind for lobe in lobes] == ["oren-nayar", "microfacet"]
    black = lobes_of(Lambert(0.0))
    assert black is not None
    assert len(black) == 1


def test_slopes_share_the_surface() -> None:
    material = CookTorrance(
        0.3, 0.8, 0.1, slope_2=0.2, slope_3=0.4, weight_2=0.6, weight_3=0.25, lobes="3", weights="complementary"
    )
    lobes = lobes_of(material)
    assert lobes is not None
    assert float(lobes[0].values["albedo"]) == pytest.approx(0.3 * 0.2)
    shares = [float(lobe.values["specular"]) for lobe in lobes[1:]]
    assert shares == pytest.approx([0.8 * 0.4, 0.8 * 0.45, 0.8 * 0.15])


def test_torrance_and_sparrows_lobe_is_a_gaussian_of_the_facet_angle() -> None:
    lobes = lobes_of(TorranceSparrow(0.02, 0.3))
    assert lobes is not None
    assert float(lobes[0].values["slope"]) == pytest.approx(0.3 * math.sqrt(2))
    assert lobes[0].words["distribution"] == "gaussian"


@pytest.mark.parametrize(
    "material",
    [
        BlinnPhong(0.1, 0.5),
        HeTorrance(),
        Lambert(0.2) + BlinnPhong(0.0, 0.5),
        preset("non-glare-glass"),
    ],
    ids=lambda material: material.expression,
)
def test_materials_with_other_parts_have_no_lobes(material: Brdf) -> None:
    assert lobes_of(material) is None


def test_slopes_along_two_directions_are_two_values() -> None:
    lobes = lobes_of(Ward(0.1, 0.5, slope_x=0.1, slope_y=0.3, anisotropy="axes"))
    assert lobes is not None
    assert [float(lobes[1].values[f"slope_{axis}"]) for axis in "xy"] == [0.1, 0.3]
    brushed = LiTorrance(height_rms=0.6, correlation_length_x=4.0, correlation_length_y=12.0, anisotropy="corrected")
    lobes = lobes_of(brushed)
    assert lobes is not None
    assert [float(lobes[1].values[f"slope_ratio_{axis}"]) for axis in "xy"] == pytest.approx([0.15, 0.05])
    assert lobes[1].words["anisotropy"] == "corrected"


def test_diffuse_models_are_matte() -> None:
    assert is_matte(lobes_of(OrenNayar(0.5, 0.4)))
    assert not is_matte(lobes_of(CookTorrance(0.1, 0.5, 0.2)))
    assert not is_matte(None)


def test_a_dielectric_of_four_per_cent_has_index_one_and_a_half() -> None:
    assert float(index_of(torch.tensor(0.04, dtype=torch.float64))) == pytest.approx(1.5)
