"""From the tables of geometry and camera to the surface that the images show."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from matest.capture import schema
from matest.capture.description import describe
from matest.capture.geometry import check_size, visible_surface
from matest.errors import InputError
from matest.photographs.images import write_image
from tests.captures import CENTRE, RADIUS, SHAPE, CaptureFolder, sphere_normals


def test_supersampling_keeps_the_shape_and_multiplies_the_pixels(folder: CaptureFolder) -> None:
    description = describe(folder.save(), schema.CaptureFile)
    plain, fine = (visible_surface(description, SHAPE, factor) for factor in (1, 3))
    assert fine.shape == (3 * SHAPE[0], 3 * SHAPE[1])
    mask = plain.mask.repeat(3, axis=0).repeat(3, axis=1)
    # The mask leaves out whole pixels, the sphere parts of them.
    assert not (fine.mask & ~mask).any()
    middle = fine.image(fine.normals.numpy())[1::3, 1::3]
    np.testing.assert_allclose(middle[plain.mask], plain.normals.numpy(), atol=1e-12)


@pytest.mark.parametrize("kind", ["mesh", "normals", "circle of the mask"])
def test_every_kind_of_geometry_shows_the_same_sphere(folder: CaptureFolder, kind: str) -> None:
    expected = visible_surface(describe(folder.save(), schema.CaptureFile), SHAPE)
    if kind == "mesh":
        trimesh.creation.icosphere(5).export(folder.path / "ball.ply")
        # One world unit is the radius; the circle's centre is the origin.
        target = [(SHAPE[1] / 2 - CENTRE[0]) / RADIUS, (CENTRE[1] - SHAPE[0] / 2) / RADIUS, 0.0]
        camera = {"position": [*target[:2], 5.0], "target": target, "height": SHAPE[0] / RADIUS}
        folder.tables |= {"geometry": {"mesh": "ball.ply"}, "camera": camera}
    elif kind == "normals":
        write_image(folder.path / "normals.exr", sphere_normals())
        folder.tables["geometry"] = {"normals": "normals.exr"}
    else:
        folder.tables["geometry"] = {"shape": "sphere"}
    surface = visible_surface(describe(folder.save(), schema.CaptureFile), SHAPE)
    common = expected.mask & surface.mask
    assert common.sum() > 0.98 * len(expected)
    difference = surface.image(surface.normals.numpy())[common] - expected.image(expected.normals.numpy())[common]
    # Normals of a fitted circle, and of triangles, are those of the sphere to a few hundredths of a radian.
    assert np.sqrt(np.square(difference).sum(-1).mean()) < 0.05


def test_a_normal_map_of_a_stated_width_lies_in_a_plane(folder: CaptureFolder) -> None:
    np.save(folder.path / "normals.npy", sphere_normals().astype(np.float32))
    folder.tables["geometry"] = {"normals": "normals.npy", "width": 12.0}
    surface = visible_surface(describe(folder.save(), schema.CaptureFile), SHAPE)
    rows, columns = np.divmod(surface.pixels, SHAPE[1])
    pixel = 12.0 / SHAPE[1]
    expected = [pixel * (columns + 0.5 - SHAPE[1] / 2), pixel * (SHAPE[0] / 2 - rows - 0.5), 0 * rows]
    assert surface.positions is not None
    np.testing.assert_allclose(surface.positions.numpy().T, expected, atol=1e-12)


def test_integers_encode_normals_and_a_background_of_zeros(folder: CaptureFolder) -> None:
    normals = sphere_normals()
    codes = np.where(normals.any(axis=2, keepdims=True), np.round((normals + 1) / 2 * 65535), 0).astype(np.uint16)
    write_image(folder.path / "normals.png", codes)
    folder.tables["geometry"] = {"normals": "normals.png"}
    surface = visible_surface(describe(folder.save(), schema.CaptureFile), SHAPE)
    assert len(surface) == int(codes.any(axis=2).sum())
    np.testing.assert_allclose(surface.normals.numpy(), normals.reshape(-1, 3)[surface.pixels], atol=1e-4)


def test_an_image_of_another_size_is_refused_with_both_sizes() -> None:
    check_size(np.zeros((4, 6)), (4, 6), "a frame")
    with pytest.raises(InputError, match="a frame must have the size of the images \\(4×6\\); got 2×6"):
        check_size(np.zeros((2, 6)), (4, 6), "a frame")
