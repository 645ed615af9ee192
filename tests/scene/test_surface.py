from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh
from scipy.ndimage import binary_dilation, binary_erosion

from matest.scene import Camera, Mesh
from matest.scene.surface import from_mesh, from_normals, from_sphere
from tests.captures import refusal
from tests.scene.discs import disc

ABOVE = Camera(position=(0, 0, 10), height=4.0)
SQUARE = np.ones((3, 3), bool)


def as_mesh(*parts: trimesh.Trimesh) -> Mesh:
    joined = trimesh.util.concatenate(parts)
    return Mesh(joined.vertices, joined.faces)


def plate(width: float, height: float) -> trimesh.Trimesh:
    """A square of two triangles parallel to the image at z = `height`, facing the viewer."""
    half = width / 2
    corners = [(-half, -half, height), (half, -half, height), (half, half, height), (-half, half, height)]
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)])


def near_outside(mask: np.ndarray, pixels: int) -> np.ndarray:
    """Object pixels with background at most `pixels` away along rows, columns or both; the image's border is none."""
    return mask & ~binary_erosion(mask, SQUARE, iterations=pixels, border_value=1)


def test_sphere_normals_are_the_positions_on_the_unit_sphere():
    surface = from_sphere((50, 60), (31.25, 22.5), 20.5, None)
    rows, columns = np.divmod(surface.pixels, 60)
    x, y = (columns + 0.5 - 31.25) / 20.5, -(rows + 0.5 - 22.5) / 20.5
    expected = np.stack([x, y, np.sqrt(1 - x**2 - y**2)], axis=1)
    np.testing.assert_allclose(surface.normals.numpy(), expected, atol=1e-12)
    torch.testing.assert_close(surface.positions, surface.normals)
    assert surface.view.tolist() == [[0.0, 0.0, 1.0]]


def test_sphere_pixels_are_those_with_their_centre_inside_the_circle_and_the_mask():
    mask = np.indices((50, 60))[1] < 30
    surface = from_sphere((50, 60), (31.25, 22.5), 20.5, mask)
    np.testing.assert_array_equal(surface.mask, (disc((50, 60), (31.25, 22.5), 20.5, 1) > 0) & mask)


def test_rim_is_two_pixels_wide_along_the_silhouette():
    surface = from_sphere((50, 60), (31.25, 22.5), 20.5, None)
    rim = surface.image(surface.rim)
    np.testing.assert_array_equal(rim, near_outside(surface.mask, 2))


def test_the_border_of_the_image_is_no_silhouette():
    surface = from_sphere((40, 40), (20.0, 20.0), 40.0, None)
    assert len(surface) == 1600
    assert not surface.rim.any()


def test_an_orthographic_camera_sees_the_mesh_whole_wherever_it_stands_on_its_line_of_sight():
    mesh = as_mesh(plate(3.0, 0.0), plate(1.5, 1.0))
    expected = from_mesh(mesh, ABOVE, (80, 80))
    for height in (1000.0, 0.5, -5.0, -12.0, -1000.0):
        camera = Camera(position=(0, 0, height), target=(0, 0, height - 1), height=4.0)
        surface = from_mesh(mesh, camera, (80, 80))
        np.testing.assert_array_equal(surface.pixels, expected.pixels)
        torch.testing.assert_close(surface.positions, expected.positions)
        np.testing.assert_array_equal(surface.rim, expected.rim)


def test_a_mesh_without_a_pixel_in_the_mask_is_refused():
    assert "mask" in refusal(lambda: from_mesh(as_mesh(plate(3.0, 0.0)), ABOVE, (80, 80), np.zeros((80, 80), bool)))


def test_rim_follows_jumps_in_depth_on_both_sides():
    surface = from_mesh(as_mesh(plate(3.9, 0.0), plate(1.5, 1.0)), ABOVE, (80, 80))
    high = surface.image(surface.positions[:, 2].numpy(), np.nan) > 0.5
    rim = surface.image(surface.rim)
    outline = near_outside(surface.mask, 2)
    beside_jump = binary_dilation(high, SQUARE, iterations=2) & ~binary_erosion(high, SQUARE, iterations=2)
    assert beside_jump.sum() > 400
    assert rim[beside_jump].all()
    # A jump shows in the 3×3 pixels around it, so one more pixel may go on either side.
    wider = binary_dilation(high, SQUARE, iterations=3) & ~binary_erosion(high, SQUARE, iterations=3)
    assert not rim[surface.mask & ~outline & ~wider].any()


@pytest.mark.parametrize("tilt", [0.0, 1.0, 1.4], ids=["0°", "57°", "80°"])
def test_a_tilted_plane_has_no_jump_in_depth(tilt):
    tilted = plate(20.0, 0.0).apply_transform(trimesh.transformations.rotation_matrix(tilt, (0.3, 1, 0)))
    surface = from_mesh(as_mesh(tilted), Camera(position=(0, 0, 30), height=2.0), (40, 40))
    assert len(surface) == 1600
    assert not surface.rim.any()


def test_a_sphere_mesh_is_seen_like_the_analytic_sphere():
    mesh = as_mesh(trimesh.creation.icosphere(6))
    seen = from_mesh(mesh, Camera(position=(0, 0, 10), height=2.5), (50, 60))
    exact = from_sphere((50, 60), (30.0, 25.0), 20.0, None)
    inner = exact.take(~exact.rim)
    rows = np.searchsorted(seen.pixels, inner.pixels)
    np.testing.assert_array_equal(seen.pixels[rows], inner.pixels)
    np.testing.assert_allclose(seen.positions[rows], inner.positions, atol=1e-3)
    np.testing.assert_allclose(seen.normals[rows], inner.normals, atol=2e-3)
    assert set(seen.pixels) <= set(exact.pixels)


@pytest.mark.parametrize(
    "camera",
    [
        Camera(position=(2, 1, 3), target=(0.1, 0, 0), height=3.0),
        Camera(position=(2, 1, 3), target=(0.1, 0, 0), fov_y=0.8),
    ],
    ids=["orthographic", "perspective"],
)
def test_hits_lie_on_the_surface_and_on_the_ray_of_their_pixel(camera):
    surface = from_mesh(as_mesh(trimesh.creation.icosphere(6)), camera, (40, 50))
    np.testing.assert_allclose(surface.positions.norm(dim=1), 1, atol=2e-4)
    origins, directions = camera.rays((40, 50), surface.pixels)
    across = np.cross(surface.positions.numpy() - origins, directions)
    np.testing.assert_allclose(across, 0, atol=1e-12)
    np.testing.assert_allclose(surface.view.expand(len(surface), 3), -directions, atol=1e-14)
    assert ((surface.normals * surface.view).sum(-1) > 0).all()


def test_the_faces_of_a_box_keep_their_own_normals():
    box = as_mesh(trimesh.creation.box((2.0, 2.0, 2.0)))
    surface = from_mesh(box, ABOVE, (40, 40))
    np.testing.assert_allclose(surface.normals, np.broadcast_to([0.0, 0.0, 1.0], (len(surface), 3)), atol=1e-6)


def test_one_viewing_direction_is_kept_for_an_orthographic_camera_and_one_per_pixel_otherwise():
    mesh = as_mesh(trimesh.creation.icosphere(3))
    assert len(from_mesh(mesh, ABOVE, (20, 20)).view) == 1
    near = from_mesh(mesh, Camera(position=(0, 0, 5), fov_y=0.5), (20, 20))
    assert near.view.shape == near.normals.shape


def test_a_mask_restricts_what_is_seen_of_a_mesh():
    mask = np.indices((40, 40))[0] < 15
    mesh = as_mesh(trimesh.creation.icosphere(3))
    whole, part = from_mesh(mesh, ABOVE, (40, 40)), from_mesh(mesh, ABOVE, (40, 40), mask)
    np.testing.assert_array_equal(part.mask, whole.mask & mask)


@pytest.mark.parametrize("camera", [ABOVE, Camera(position=(0, 0, 10), fov_y=0.4)])
def test_a_mesh_outside_the_view_is_refused(camera):
    far = as_mesh(trimesh.creation.icosphere(2).apply_translation((500, 0, 0)))
    message = refusal(lambda: from_mesh(far, camera, (30, 40)))
    assert "outside the view" in message
    assert "40×30" in message
    assert "[499.0, -1.0, -1.0]" in message


def test_a_mesh_outside_the_mask_is_refused():
    mask = np.zeros((30, 40), bool)
    mask[0, 0] = True
    assert "mask" in refusal(lambda: from_mesh(as_mesh(plate(0.5, 0.0)), ABOVE, (30, 40), mask))


def test_zero_nan_and_averted_normals_are_background():
    normals = np.zeros((3, 4, 3), np.float32)
    normals[0] = (0, 0, 1)
    normals[1] = (0.6, 0, -0.8)
    normals[2] = np.nan
    normals[2, 3] = (0, 0.6, 0.8)
    surface = from_normals(normals, None)
    assert surface.pixels.tolist() == [0, 1, 2, 3, 11]
    assert surface.positions is None


def test_normals_of_a_map_are_normalised_in_double_precision():
    rng = np.random.default_rng(3)
    normals = rng.uniform(-0.5, 0.5, (5, 6, 3)).astype(np.float32) + np.array([0, 0, 1.1], np.float32)
    surface = from_normals(normals, None)
    expected = normals.reshape(-1, 3).astype(np.float64)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(surface.normals, expected, atol=1e-15)


def test_the_viewer_of_a_map_with_positions_is_where_the_camera_is():
    rng = np.random.default_rng(4)
    normals = np.broadcast_to([0.0, 0.0, 1.0], (4, 5, 3))
    positions = rng.uniform(-1, 1, (4, 5, 3))
    camera = Camera(position=(0.5, 0.2, 6.0), fov_y=0.5)
    surface = from_normals(normals, camera, None, positions)
    toward = np.array(camera.position) - positions.reshape(-1, 3)
    np.testing.assert_allclose(surface.view, toward / np.linalg.norm(toward, axis=1, keepdims=True), atol=1e-14)
    np.testing.assert_array_equal(surface.positions, positions.reshape(-1, 3))


def test_image_puts_values_at_their_pixels_and_take_keeps_them_aligned():
    surface = from_sphere((20, 30), (15.0, 10.0), 8.0, None)
    kept = surface.normals[:, 0].numpy() > 0.2
    part = surface.take(kept)
    image = part.image(part.normals.numpy(), -9.0)
    assert image.shape == (20, 30, 3)
    np.testing.assert_array_equal(image[~part.mask], -9.0)
    np.testing.assert_array_equal(image[part.mask], surface.normals.numpy()[kept])
    np.testing.assert_array_equal(part.mask, surface.image(kept))


def test_rays_cast_in_parts_give_the_same_surface(monkeypatch):
    vase = trimesh.creation.capsule(height=1.0, radius=0.5)
    camera = Camera(position=(0.5, 0.2, 5.0), fov_y=30.0)
    mesh = Mesh(vase.vertices, vase.faces)
    whole = from_mesh(mesh, camera, (40, 50))
    monkeypatch.setattr("matest.scene.sight._RAYS", 300)
    parts = from_mesh(mesh, camera, (40, 50))
    np.testing.assert_array_equal(parts.pixels, whole.pixels)
    np.testing.assert_array_equal(parts.rim, whole.rim)
    for name in ("normals", "positions", "view"):
        assert torch.equal(getattr(parts, name), getattr(whole, name))
