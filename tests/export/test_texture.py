"""Maps in texture space agree with the truth on the surface, and several views with each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.export.atlas import Atlas, atlas_of
from matest.export.texture import GUTTER, Coverage, Texture, View, merged, texture_size
from matest.scene import Camera
from matest.scene.mesh import Mesh
from matest.scene.surface import from_mesh
from tests.export.two_tone import SHAPE, STD, to_edge, truth, vase, view

SIZE = 256
# Distance from the edge of the colours within which a pixel or the bilinear look-up mixes them.
MIXED = 0.03


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return atlas_of(vase(texture=True), "result")


def texture_of(atlas: Atlas, *views: View) -> tuple[Texture, Coverage]:
    textures, coverage, _ = merged(atlas, views, SIZE)
    return textures["albedo"], coverage


def errors(atlas: Atlas, texture: Texture) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors and standard errors [n, 3] of the seen texels off the edge, and their places on the surface [n, 3]."""
    texels = atlas.texels(SIZE)
    points = texels.mixed(atlas.mesh.triangles)
    kept = (texture.status.ravel()[texels.places] > 0) & (to_edge(points) > MIXED)
    value, std = (part.reshape(-1, 3)[texels.places][kept] for part in (texture.value, texture.std))
    return value - truth(points[kept]), std, points[kept]


@pytest.mark.parametrize("perspective", [False, True], ids=["orthographic", "perspective"])
def test_a_view_puts_its_values_on_the_side_that_it_sees(atlas: Atlas, perspective: bool) -> None:
    seen = view(0, perspective=perspective)
    texture, coverage = texture_of(atlas, seen)
    error, std, points = errors(atlas, texture)
    assert np.abs(error).max() < 7 * STD
    np.testing.assert_allclose(std, STD, rtol=1e-5)
    # Bilinear means of independent errors are smaller than one that all share.
    assert np.sqrt((error**2).mean()) == pytest.approx(0.7 * STD, rel=0.1)
    toward = seen.camera.toward(points)
    assert (np.einsum("ij,ij->i", toward, points * (1, 0, 1)) > -0.3 * np.linalg.norm(toward, axis=1)).all()
    assert 0.4 < coverage.seen < 0.5
    assert coverage.repeated == 0
    assert coverage.difference is None


def test_views_from_several_sides_cover_more_and_agree_with_the_truth(atlas: Atlas) -> None:
    views = [view(angle, seed=angle) for angle in (0, 60, 120, 180, 240, 300)]
    one, two, all_of_them = (texture_of(atlas, *views[:count]) for count in (1, 2, 6))
    assert one[1].seen < two[1].seen < all_of_them[1].seen == pytest.approx(1, abs=1e-3)
    assert two[1].repeated > 0.15
    error, std, _ = errors(atlas, all_of_them[0])
    assert (np.abs(error) < 1.96 * std).mean() > 0.95
    assert np.median(std) < 0.8 * STD
    # Differences of independent means of normal numbers.
    assert two[1].difference == pytest.approx(0.7 * 0.67, abs=0.1)


def test_the_mean_of_views_is_weighted_by_their_error_bars(atlas: Atlas) -> None:
    def flat(value: float, std: float) -> View:
        seen = view(0)
        values = torch.full_like(seen.maps["albedo"].value, value)
        each = replace(seen.maps["albedo"], value=values, std=torch.full_like(values, std))
        return replace(seen, maps={"albedo": each})

    texture, coverage = texture_of(atlas, flat(0.50, 0.01), flat(0.51, 0.02))
    known = texture.status == TexelStatus.DETERMINED
    np.testing.assert_allclose(texture.value[known], 0.502, atol=1e-6)
    np.testing.assert_allclose(texture.std[known], 1 / np.hypot(1 / 0.01, 1 / 0.02), rtol=1e-3)
    assert coverage.difference == pytest.approx(0.01 / np.hypot(0.01, 0.02), rel=1e-3)
    # Beyond their error bars: the standard error is that of their scatter.
    texture, _ = texture_of(atlas, flat(0.5, 0.01), flat(0.6, 0.01))
    np.testing.assert_allclose(np.median(texture.std[known]), 0.05, rtol=1e-3)


def test_what_a_view_does_not_determine_gives_way_to_one_that_does(atlas: Atlas) -> None:
    seen = view(0)
    each = seen.maps["albedo"]
    shared = replace(
        each,
        value=torch.full_like(each.value, 0.9),
        std=torch.full_like(each.value, 1e-4),
        status=torch.full_like(each.status, TexelStatus.SHARED),
    )
    alone, _ = texture_of(atlas, replace(seen, maps={"albedo": shared}))
    assert set(np.unique(alone.status)) == {TexelStatus.UNSEEN, TexelStatus.SHARED}
    both, _ = texture_of(atlas, replace(seen, maps={"albedo": shared}), view(0, seed=1))
    assert set(np.unique(both.status)) == {TexelStatus.UNSEEN, TexelStatus.DETERMINED}
    assert np.abs(errors(atlas, both)[0]).max() < 7 * STD


def test_pixels_without_a_value_are_not_seen(atlas: Atlas) -> None:
    seen = view(0)
    each = seen.maps["albedo"]
    assert seen.surface.positions is not None
    dark = seen.surface.positions[:, 1] > 0
    value, std = (part.masked_fill(dark[:, None], float("nan")) for part in (each.value, each.std))
    each = ParameterMap("albedo", value, std, each.status.masked_fill(dark, TexelStatus.UNSEEN))
    texture, coverage = texture_of(atlas, replace(seen, maps={"albedo": each}))
    _, _, points = errors(atlas, texture)
    assert points[:, 1].max() < 0.03
    assert np.isfinite(texture.value).all()
    assert coverage.seen < 0.35


def test_what_hides_a_part_keeps_its_colour_off_it() -> None:
    front = np.array([[-0.3, -0.3, 0.5], [0.3, -0.3, 0.5], [0.3, 0.3, 0.5], [-0.3, 0.3, 0.5]])
    back = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = Mesh(
        np.concatenate([back, front]),
        np.concatenate([faces, faces + 4]),
        uv=np.concatenate([0.45 * square, 0.5 + 0.45 * square]),
    )
    camera = Camera(position=(0.5, 0, 3), target=(0, 0, 0), fov_y=0.9)
    surface = from_mesh(mesh, camera, (200, 200))
    assert surface.faces is not None
    value = torch.from_numpy(np.where(surface.faces < 2, 0.2, 0.8))[:, None]
    status = torch.full((len(value),), TexelStatus.DETERMINED, dtype=torch.uint8)
    each = ParameterMap("albedo", value, 0.01 * torch.ones_like(value), status)
    atlas = atlas_of(mesh, "result")
    textures, _, _ = merged(atlas, [View(surface, camera, {"albedo": each})], SIZE)
    texels = atlas.texels(SIZE)
    found, seen = (part.reshape(-1)[texels.places] for part in (textures["albedo"].value, textures["albedo"].status))
    np.testing.assert_allclose(found[(seen > 0) & (texels.faces < 2)], 0.2, atol=1e-6)
    np.testing.assert_allclose(found[(seen > 0) & (texels.faces >= 2)], 0.8, atol=1e-6)
    # The shadow of the front on the back, from the eye, by similar triangles.
    points = texels.mixed(mesh.triangles)
    eye = np.array(camera.position)
    crossing = eye + (points - eye) * ((eye[2] - 0.5) / (eye[2] - points[:, 2]))[:, None]
    inside = np.abs(crossing[:, :2]).max(axis=1)
    assert (seen[(texels.faces < 2) & (inside < 0.28)] == 0).all()
    assert (seen[(texels.faces < 2) & (inside > 0.34)] > 0).all()


def test_views_of_unknown_scale_are_brought_to_that_of_the_first(atlas: Atlas) -> None:
    views = [view(0, seed=1), replace(view(60, seed=2, scale=2.0), relative=True), view(180, seed=3)]
    textures, _, scales = merged(atlas, views, SIZE, frozenset({"albedo"}))
    assert scales == [1, pytest.approx(0.5, rel=0.01), 1]
    error, std, _ = errors(atlas, textures["albedo"])
    assert (np.abs(error) < 1.96 * std).mean() > 0.95
    apart = [view(0), replace(view(180, scale=2.0), relative=True)]
    assert np.isnan(merged(atlas, apart, SIZE, frozenset({"albedo"}))[2][1])


def test_a_gutter_around_what_is_seen_has_the_nearest_value_and_no_status(atlas: Atlas) -> None:
    texture, _ = texture_of(atlas, view(0))
    filled = (texture.std > 0).any(axis=2)
    gutter = filled & (texture.status == 0)
    assert gutter.any()
    rows, columns = np.nonzero(texture.status)
    for row, column in np.argwhere(gutter)[::97]:
        distance = np.hypot(rows - row, columns - column)
        assert distance.min() <= GUTTER
        nearest = distance <= distance.min() + 1e-9
        values = texture.value[rows[nearest], columns[nearest]]
        assert (values == texture.value[row, column]).all(axis=1).any()
    np.testing.assert_allclose(texture.filled[~filled], np.broadcast_to(texture.mean, texture.filled[~filled].shape))


def test_a_texel_is_about_as_wide_as_a_pixel(atlas: Atlas) -> None:
    size = texture_size(atlas, [view(0)])
    assert 2 ** round(np.log2(size)) == size
    pixels = 2.4 / SHAPE[0]
    assert 0.7 < size / max(atlas.resolution(pixels), 256) < 1.42
