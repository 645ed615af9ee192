"""The object's own normals as its viewer sees them, and what is relit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from matest.brdf import Lambert, model
from matest.report.raster import Raster
from matest.report.relight import (
    EXPOSURE,
    Relighting,
    facing_normals,
    relight_section,
    relighting,
    relit_sphere,
    viewer_frame,
)
from matest.scene import Surface
from matest.shading import render_image
from tests.captures import sphere_surface
from tests.estimates import clay
from tests.mapped import mapped, photographs
from tests.simulated import Studio, coloured

STUDIO = Studio(size=48, lights=coloured())
EVERY = Raster.of(STUDIO.scene.surface, 1)


def turned(surface: Surface, turn: torch.Tensor) -> Surface:
    """A surface and its viewer, turned in the world."""
    assert surface.positions is not None
    assert surface.sightlines is not None
    parts = {name: getattr(surface, name) @ turn.T for name in ("normals", "positions", "sightlines")}
    return replace(surface, **parts)


def test_an_object_that_is_turned_with_its_camera_looks_the_same() -> None:
    surface = sphere_surface(48)
    index = np.arange(len(surface))
    c, s = math.cos(0.7), math.sin(0.7)
    about_y = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
    about_x = torch.tensor([[1, 0, 0], [0, c, -s], [0, s, c]], dtype=torch.float64)
    turn = about_y @ about_x
    other = turned(surface, turn)
    frame = viewer_frame(other, index)
    torch.testing.assert_close(frame, turn.T, atol=1e-9, rtol=0)
    torch.testing.assert_close(facing_normals(other, frame, index), surface.normals.double(), atol=1e-9, rtol=0)


def test_near_a_camera_the_angle_to_the_viewer_is_kept() -> None:
    surface = sphere_surface(48)
    eye = torch.tensor([0.3, -0.2, 3.0], dtype=torch.float64)
    near = replace(surface, sightlines=None, eye=eye)
    index = np.arange(0, len(surface), 7)
    normals = facing_normals(near, viewer_frame(near, index), index)
    cosines = (surface.normals.double() * near.view).sum(-1)[index]
    torch.testing.assert_close(normals[:, 2], cosines, atol=1e-9, rtol=0)
    torch.testing.assert_close(normals.norm(dim=-1), torch.ones(len(index)).double(), atol=1e-9, rtol=0)


def test_under_a_photograph_s_light_it_is_the_photograph_s_model() -> None:
    material = Lambert([0.6, 0.5, 0.4])
    relit = relighting(clay(material=material), STUDIO.scene, EVERY)
    assert isinstance(relit, Relighting)
    for number in (0, 4):
        truth = render_image(STUDIO.scene, number, material).reshape(-1, 3)[relit.pixels].double()
        # Normals are stored in steps of a thousandth, which at the rim is more of what points to the viewer.
        torch.testing.assert_close(relit.radiance(relit.lights[number]), truth, atol=3e-3, rtol=0)


def test_the_brightest_pixels_are_at_the_stated_exposure() -> None:
    relit = relighting(clay(material=Lambert(0.5)), STUDIO.scene, EVERY)
    assert isinstance(relit, Relighting)
    bright = relit.radiance(relit.lights[0]).amax(-1).quantile(0.995)
    assert float(bright) * EXPOSURE / relit.white == pytest.approx(EXPOSURE, rel=0.01)


def test_maps_keep_their_values_at_every_pixel() -> None:
    surface = photographs().scene.surface
    relit = relighting(mapped(), photographs().scene, Raster.of(surface, 2))
    assert isinstance(relit, Relighting)
    albedo = relit.material.parameters["albedo"]
    assert albedo.shape == (len(relit.pixels), 1)
    assert 0.25 < float(albedo.min()) < 0.35
    assert 0.65 < float(albedo.max()) < 0.75


def test_what_cannot_be_relit_says_why() -> None:
    ward = model("ward(anisotropy=axes)")[0]
    said = relighting(clay(material=ward, model="ward(anisotropy=axes)"), STUDIO.scene, EVERY)
    assert isinstance(said, str)
    assert "anisotropic" in said
    assert relight_section(clay(), said, []) == f"<p>{said}</p>"
    assert relight_section(clay(), None, []) == ""


def test_an_object_that_no_preview_shows_is_not_relit() -> None:
    nothing = Raster(EVERY.shape, EVERY.index[:0], np.zeros_like(EVERY.sources))
    assert "too thin" in str(relighting(clay(), STUDIO.scene, nothing))


def test_a_material_without_photographs_lights_a_sphere() -> None:
    relit = relit_sphere(clay(material=Lambert([0.5, 0.4, 0.3])))
    assert isinstance(relit, Relighting)
    section = relight_section(clay(), relit, ["above"])
    assert 'id="relight-data"' in section
    assert 'id="relight-shader"' in section
