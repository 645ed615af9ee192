"""The papers' figures that are rendered: `renders/gallery.py`, `renders/README.md` and the scenes."""

from __future__ import annotations

import importlib
import importlib.util
import math
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pytest
import torch
from PIL import Image

import matest
from matest import spectra
from matest.brdf import CookTorrance
from matest.photographs.images import read_image
from matest.scene import illuminate
from matest.scene.lights import DirectionalLight

RENDERS = Path(__file__).parents[1] / "renders"
pytestmark = pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="optical constants are missing")


class Gallery(NamedTuple):
    module: ModuleType
    folder: Path
    page: str


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gallery]:
    """All pictures and their page, rendered into an empty folder."""
    folder = tmp_path_factory.mktemp("renders")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(RENDERS)
        module = importlib.import_module("gallery")
        patch.setattr(module, "HERE", folder)
        module.main([])
        yield Gallery(module, folder, (folder / "README.md").read_text("utf-8"))


def test_the_page_that_ships_says_what_the_renders_measure(gallery: Gallery) -> None:
    assert gallery.page == (RENDERS / "README.md").read_text("utf-8")


def test_the_pictures_that_ship_are_what_the_scenes_give(gallery: Gallery) -> None:
    drawn = {path.relative_to(gallery.folder) for path in gallery.folder.rglob("*.png")}
    assert drawn == {path.relative_to(RENDERS) for path in RENDERS.rglob("figure.png")}
    for path in drawn:
        ours, shipped = (Image.open(folder / path).convert("RGB") for folder in (gallery.folder, RENDERS))
        # Processors round differently: the shade of a single pixel may be the next.
        difference = np.asarray(ours).astype(int) - np.asarray(shipped)
        assert np.abs(difference).max() <= 1
        assert np.count_nonzero(difference) < 100
        assert (RENDERS / path).stat().st_size < 150_000


@pytest.mark.parametrize(
    ("sphere", "ratio", "tolerance"),
    [("0 (Lambert)", 0.5, 0.001), ("40°", 0.832, 0.002), ("40°, the integral", 0.848, 0.003)],
)
def test_a_rough_sphere_is_as_flat_as_the_equations_say(
    gallery: Gallery, sphere: str, ratio: float, tolerance: float
) -> None:
    measured = re.search(rf"\| {re.escape(sphere)} \| (0\.\d+) \|", gallery.page)
    assert measured is not None
    assert float(measured[1]) == pytest.approx(ratio, abs=tolerance)


def test_a_metal_is_rendered_as_every_wavelength_by_itself_would(gallery: Gallery) -> None:  # noqa: ARG001
    scenes = importlib.import_module("papers.cook_torrance_scenes")
    generator = torch.Generator().manual_seed(7)
    normals = torch.nn.functional.normalize(
        torch.rand(64, 3, generator=generator) - torch.tensor([0.5, 0.5, 0]), dim=-1
    )
    toward_light = torch.nn.functional.normalize(torch.tensor([0.75, 0.45, 0.5]), dim=0)
    lights = [DirectionalLight(toward_light, torch.ones(1))]
    points = illuminate(normals, torch.tensor([[0.0, 0, 1]]), lights, ambient=torch.tensor([[0.02]]))
    every_10_nm = spectra.VISIBLE[::2]
    eta, k = spectra.optical_constants("gold").at(every_10_nm)
    metal = CookTorrance(**scenes.FINISH, eta=eta, k=k, fresnel="conductor")
    expected = spectra.to_rgb(matest.shade(metal, points), every_10_nm)
    error = (scenes.spectral_radiance("gold", points) - expected).abs().max() / expected.max()
    assert float(error) < 2e-3


@pytest.mark.parametrize("angle", [30, 45, 60])
def test_a_rough_mirror_emerges_toward_grazing_angles_as_equation_2_says(gallery: Gallery, angle: int) -> None:
    row = re.search(rf"\| {angle}° \|" + r" (0\.\d+) \|" * 3, gallery.page)
    assert row is not None
    for measured, wavelength in zip(row.groups(), (0.61, 0.55, 0.46), strict=True):
        rough, smooth = (
            math.exp(-((4 * math.pi * height * math.cos(math.radians(angle)) / wavelength) ** 2))
            for height in (0.11, 0.01)
        )
        assert float(measured) == pytest.approx(rough / smooth, abs=2e-3)


def test_the_map_that_ships_is_the_room(gallery: Gallery) -> None:  # noqa: ARG001
    rebuild = importlib.import_module("rebuild")
    np.testing.assert_array_equal(read_image(RENDERS / rebuild.ROOM), rebuild.room())


def test_the_meshes_that_ship_are_those_of_their_shapes(gallery: Gallery) -> None:  # noqa: ARG001
    rebuild = importlib.import_module("rebuild")
    for path, shape in rebuild.MESHES.items():
        assert rebuild.shapes.ply(shape()) == (RENDERS / path).read_bytes(), path
