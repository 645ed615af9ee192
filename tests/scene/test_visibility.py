from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh
from scipy.ndimage import binary_dilation, binary_erosion

from matest.scene import Camera, Mesh, PointLight, Scene, Surface, visibility
from matest.scene.source import Source
from matest.scene.surface import from_mesh, from_sphere
from matest.scene.visibility import cast_shadows, shadow_edges, unoccluded_fraction
from tests.captures import directional, point, scene_of

HEIGHT = 0.7
HALF = 0.4
# Origins of shadow rays stand this far off the surface, a ten-thousandth of the mesh's size.
CLEARANCE = 1e-3


def square(half: float, height: float) -> trimesh.Trimesh:
    """A horizontal square of two triangles facing up."""
    corners = [(-half, -half, height), (half, -half, height), (half, half, height), (-half, half, height)]
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)])


@pytest.fixture(scope="module")
def plate_above_plane() -> Surface:
    """A small square over a large one, seen from straight above."""
    joined = trimesh.util.concatenate([square(2.0, 0.0), square(HALF, HEIGHT)])
    mesh = Mesh(joined.vertices, joined.faces)
    return from_mesh(mesh, Camera(position=(0, 0, 10), height=3.0), (90, 90))


def shadow_of_plate(surface: Surface, light: object) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of the plane whose line to the light crosses the plate, and those too near the outline to tell."""
    positions = surface.positions
    toward = light.at(positions)[0].expand_as(positions).numpy()
    positions = positions.numpy()
    crossing = positions + (HEIGHT - positions[:, 2:]) / toward[:, 2:] * toward
    reach = np.abs(crossing[:, :2]).max(axis=1)
    low = positions[:, 2] < HEIGHT / 2
    return low & (reach < HALF), low & (np.abs(reach - HALF) < CLEARANCE)


@pytest.mark.parametrize(
    "light",
    [directional((0.6, 0.0, 0.8)), directional((-0.5, 0.4, 0.5)), point((0.3, 1.1, 2.0)), point((-0.9, 0.2, 0.9))],
    ids=["along x", "oblique", "near", "nearer"],
)
def test_the_shadow_of_a_plate_is_its_projection(plate_above_plane, light):
    shadow = cast_shadows(plate_above_plane, light)
    expected, doubtful = shadow_of_plate(plate_above_plane, light)
    assert expected.sum() > 100
    np.testing.assert_array_equal(shadow[~doubtful], expected[~doubtful])
    assert doubtful.mean() < 0.01


def test_the_sky_that_a_point_under_a_plate_sees_is_one_minus_the_form_factor_of_the_plate(plate_above_plane):
    free = unoccluded_fraction(plate_above_plane)
    positions = plate_above_plane.positions.numpy()
    # Form factor of a rectangle parallel to the surface element, from its four corners.
    blocked = np.zeros(len(positions))
    for x, y, sign in ((HALF, HALF, 1), (HALF, -HALF, -1), (-HALF, HALF, -1), (-HALF, -HALF, 1)):
        a, b = (x - positions[:, 0]) / HEIGHT, (y - positions[:, 1]) / HEIGHT
        ra, rb = np.sqrt(1 + a * a), np.sqrt(1 + b * b)
        blocked += sign * (a / ra * np.arctan(b / ra) + b / rb * np.arctan(a / rb)) / (2 * np.pi)
    below = positions[:, 2] < HEIGHT / 2
    assert blocked[below].max() > 0.2
    np.testing.assert_allclose(free[below].mean(), 1 - blocked[below].mean(), atol=5e-4)
    assert np.sqrt(np.mean((free[below] - 1 + blocked[below]) ** 2)) < 0.015
    assert (free[~below] == 1).all()


def test_the_sky_that_a_pixel_sees_does_not_depend_on_which_others_are_asked_for(plate_above_plane):
    some = np.arange(0, 8000, 7)
    np.testing.assert_array_equal(
        unoccluded_fraction(plate_above_plane, some), unoccluded_fraction(plate_above_plane)[some]
    )


def test_the_sky_is_counted_only_where_it_shines_and_something_can_block_it(plate_above_plane):
    light = (directional((0.0, 0.0, 1.0)),)
    dark = Scene(plate_above_plane, (light,), torch.zeros(1, 1, dtype=torch.float64)).with_shadows()
    assert dark.unoccluded is None
    lit = Scene(plate_above_plane, (light,), torch.full((1, 1), 0.5, dtype=torch.float64)).with_shadows()
    some = slice(100, 200)
    expected = 0.5 * torch.from_numpy(unoccluded_fraction(plate_above_plane))[some, None]
    torch.testing.assert_close(lit.points(0, some).ambient, expected)
    sphere = from_sphere((20, 20), (10.0, 10.0), 8.0, None)
    assert unoccluded_fraction(sphere) is None


def test_the_plate_itself_is_lit(plate_above_plane):
    shadow = cast_shadows(plate_above_plane, directional((0.6, 0.0, 0.8)))
    assert not shadow[plate_above_plane.positions[:, 2].numpy() > HEIGHT / 2].any()


def test_a_light_between_the_objects_is_not_blocked_by_what_lies_beyond_it(plate_above_plane):
    below_the_plate = point((0.1, 0.0, HEIGHT / 2))
    shadow = cast_shadows(plate_above_plane, below_the_plate)
    assert not shadow.any()


def test_a_box_shades_the_lower_part_of_the_face_opposite():
    boxes = [trimesh.creation.box((1, 1, 1)).apply_translation((x, 0, 0)) for x in (-1, 1)]
    joined = trimesh.util.concatenate(boxes)
    camera = Camera(position=(-0.2, 0, 6), target=(-0.9, 0, 0), height=3.0)
    surface = from_mesh(Mesh(joined.vertices, joined.faces), camera, (80, 80))
    light = directional((1.0, 0.0, 0.3))
    x, _, z = surface.positions.numpy().T
    # Over the gap of 1 the light climbs by 0.3: only the top 0.3 of the left box's right face sees it.
    clear = np.abs(z - 0.2) > CLEARANCE
    seen = (np.abs(x + 0.5) < 1e-6) & (z < 0.5) & clear & ((surface.normals @ light.direction).numpy() > 0)
    shadow = cast_shadows(surface, light)[seen]
    np.testing.assert_array_equal(shadow, z[seen] < 0.2)
    assert 10 < shadow.sum() < len(shadow) - 10


def test_pixels_turned_away_from_the_light_cost_no_ray_and_are_not_cast_shadow(plate_above_plane):
    assert not cast_shadows(plate_above_plane, directional((0.6, 0.0, -0.8))).any()


def test_convex_bodies_and_surfaces_without_mesh_cast_no_rays():
    ball = trimesh.creation.icosphere(3)
    seen = from_mesh(Mesh(ball.vertices, ball.faces), Camera(position=(0, 0, 5), height=2.5), (30, 30))
    light = directional((0.9, 0.0, 0.2))
    assert cast_shadows(seen, light) is None
    assert cast_shadows(from_sphere((30, 30), (15, 15), 12, None), light) is None
    traced = scene_of(seen, light).with_shadows()
    assert traced.shadows == (None,)
    assert traced.shadow_edge == (None,)


def test_shadow_edges_are_the_pixels_beside_a_boundary_on_either_side(plate_above_plane):
    light = directional((-0.5, 0.4, 0.5))
    shadow = cast_shadows(plate_above_plane, light)
    edge = plate_above_plane.image(shadow_edges(plate_above_plane, shadow))
    image = plate_above_plane.image(shadow)
    beside = binary_dilation(image, np.ones((3, 3))) & ~binary_erosion(image, np.ones((3, 3)))
    np.testing.assert_array_equal(edge, beside)


def test_the_silhouette_is_no_shadow_edge():
    surface = from_sphere((30, 30), (15.0, 15.0), 12.0, None)
    everywhere = np.ones(len(surface), bool)
    assert not shadow_edges(surface, everywhere).any()
    assert not shadow_edges(surface, ~everywhere).any()


def test_with_shadows_traces_every_light_of_every_image(plate_above_plane):
    first, second = directional((0.6, 0.0, 0.8)), point((-0.9, 0.2, 0.9))
    one = scene_of(plate_above_plane, first)
    scene = Scene(plate_above_plane, ((first,), (first, second), ()), one.ambient.expand(3, 1)).with_shadows()
    expected = [cast_shadows(plate_above_plane, light) for light in (first, second)]
    np.testing.assert_array_equal(np.stack(scene.shadows[0]), expected[:1])
    np.testing.assert_array_equal(np.stack(scene.shadows[1]), expected)
    assert scene.shadows[2] is None
    edges = [shadow_edges(plate_above_plane, shadow) for shadow in expected]
    np.testing.assert_array_equal(scene.shadow_edge[1], edges[0] | edges[1])


def wire(width: float) -> trimesh.Trimesh:
    """A long narrow strip above the plane, askew."""
    turn = trimesh.transformations.rotation_matrix(0.4, (0, 0, 1))
    corners = [(-1.2, -width, HEIGHT), (1.2, -width, HEIGHT), (1.2, width, HEIGHT), (-1.2, width, HEIGHT)]
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)]).apply_transform(turn)


@pytest.mark.parametrize("occluder", [square(HALF, HEIGHT), square(0.05, HEIGHT), wire(0.01), wire(0.03)])
@pytest.mark.parametrize("light", [directional((0.6, 0.0, 0.8)), point((0.3, 1.1, 2.0))], ids=["distant", "near"])
def test_large_images_have_the_shadows_that_every_ray_gives(monkeypatch, occluder, light):
    joined = trimesh.util.concatenate([square(2.0, 0.0), occluder])
    # Pixels of 0.0125: the narrower wire is less than two wide.
    surface = from_mesh(Mesh(joined.vertices, joined.faces), Camera(position=(0, 0, 10), height=3.0), (240, 240))
    expected = cast_shadows(surface, light)
    assert expected.any()
    rays = []
    blocked = Mesh.blocked
    monkeypatch.setattr(visibility, "_ALL_TRACED", 0)
    monkeypatch.setattr(Mesh, "blocked", lambda self, o, *rest: rays.append(len(o)) or blocked(self, o, *rest))
    np.testing.assert_array_equal(cast_shadows(surface, light), expected)
    assert sum(rays) < 0.5 * len(surface)


def test_a_light_with_a_size_casts_a_penumbra(plate_above_plane):
    """The share that is hidden of a panel overhead falls linearly over the penumbra of a straight edge."""
    sides = torch.tensor([[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]], dtype=torch.float64)
    above = torch.tensor([0.0, 0.0, 4.0], dtype=torch.float64)
    lamp = PointLight(above, torch.ones(1, dtype=torch.float64), axis=-above / 4, source=Source(sides, order=8))
    traced = scene_of(plate_above_plane, lamp).with_shadows()
    (shadows,), (edge,) = traced.shadows, traced.shadow_edge
    assert len(shadows) == 64
    x, y, z = plate_above_plane.positions.numpy().T
    hidden = np.mean([np.asarray(shadow[slice(None)]) for shadow in shadows], axis=0)
    # The edge of the plate at x = HALF, seen through it from the plane, meets the panel at this place.
    meets = (HALF - x * (1 - HEIGHT / 4)) / (HEIGHT / 4)
    expected = np.clip((0.5 - meets) / 1.0, 0, 1)
    row = (z == 0) & (np.abs(y) < 0.1) & (x > 0)
    # Gaussian nodes are at most a quarter of the panel's half width apart.
    assert np.abs(1 - hidden - expected)[row].max() < 0.15
    partial = row & (hidden > 0) & (hidden < 1)
    assert partial.sum() > 5
    assert np.asarray(edge[slice(None)])[partial].all()
