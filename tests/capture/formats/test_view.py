from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from matest.capture.formats.view import Lens, View, lens, rotation
from matest.scene import Camera
from tests.capture.formats.camera_files import HEIGHT, PINHOLE, POSE, WIDTH
from tests.captures import refusal


@pytest.mark.parametrize("far", [0.0, 1e5])
def test_the_table_of_a_view_gives_its_rays(far: float) -> None:
    position = POSE.position + far
    table = View(POSE.turns.as_matrix().T, position, Lens((WIDTH, HEIGHT), PINHOLE[:2], PINHOLE[2:])).table()
    camera = Camera(table.position, table.target, table.up, matrix=table.matrix)
    pixels = np.arange(WIDTH * HEIGHT)
    origins, directions = camera.rays((HEIGHT, WIDTH), pixels)
    centres = np.stack([pixels % WIDTH, pixels // WIDTH], axis=1) + 0.5
    np.testing.assert_allclose(directions, POSE.directions(centres), atol=1e-12)
    np.testing.assert_array_equal(origins, np.broadcast_to(position, origins.shape))


def test_a_lens_scales_with_its_images_if_their_shape_stays() -> None:
    half = Lens((60, 40), (70.0, 71.0), (31.0, 19.0), (0.1, 0.0, 0.0, 0.0)).scaled((30, 20))
    assert half == Lens((30, 20), (35.0, 35.5), (15.5, 9.5), (0.1, 0.0, 0.0, 0.0))
    assert Lens((60, 40), (70.0, 71.0), (31.0, 19.0)).scaled((30, 21)) is None


@pytest.mark.parametrize("values", [(0, 70, 30, 20), (70, -70, 30, 20), (70, 70, np.nan, 20), (np.inf, 70, 30, 20)])
def test_impossible_lenses_are_refused(values: tuple[float, ...]) -> None:
    assert refusal(lambda: lens("a.json", (60, 40), values, ())).startswith("a.json: focal lengths")


@pytest.mark.parametrize("size", [(60.5, 40), (0, 40)])
def test_impossible_sizes_are_refused(size: tuple[float, float]) -> None:
    assert "whole numbers of pixels" in refusal(lambda: lens("a.json", size, PINHOLE, ()))


def test_a_scale_is_split_off_and_said() -> None:
    turned = Rotation.from_euler("xyz", [0.4, 0.2, -1.0]).as_matrix()
    plain, notes = rotation("a", turned)
    np.testing.assert_allclose(plain, turned, atol=1e-14)
    assert notes == ()
    plain, notes = rotation("a", 2.5 * turned)
    np.testing.assert_allclose(plain, turned, atol=1e-14)
    assert len(notes) == 1
    assert "scales by 2.5" in notes[0]


def test_a_rotation_of_five_digits_becomes_one_of_all() -> None:
    turned = Rotation.from_euler("xyz", [0.4, 0.2, -1.0]).as_matrix()
    plain, notes = rotation("a", turned.round(5))
    np.testing.assert_allclose(plain @ plain.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(plain, turned, atol=1e-5)
    assert notes == ()


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.diag([1.0, 1.0, -1.0]), "mirrors"),
        (np.zeros((3, 3)), "no rotation"),
        (np.full((3, 3), np.nan), "no rotation"),
        (np.diag([1.0, 2.0, 0.5]), "differently"),
        (np.array([[1.0, 0.3, 0], [0, 1, 0], [0, 0, 1]]), "differently"),
    ],
    ids=["mirror", "zero", "NaN", "uneven", "shear"],
)
def test_what_is_no_rotation_is_refused(matrix: np.ndarray, words: str) -> None:
    message = refusal(lambda: rotation("a.json: frame 'b'", matrix))
    assert message.startswith("a.json: frame 'b': ")
    assert words in message
