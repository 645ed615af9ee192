from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from matest.capture.mirrors import load_mirror
from tests.captures import put_image, refusal
from tests.scene.discs import disc

SHAPE, CENTRE, RADIUS = (80, 100), (47.5, 41.25), 30.0


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two photographs, and a mask of a disc."""
    for name in ("b.png", "a.png"):
        put_image(tmp_path / name, np.zeros(SHAPE, np.uint8))
    put_image(tmp_path / "mask.png", np.round(255 * disc(SHAPE, CENTRE, RADIUS, 8)).astype(np.uint8))
    return tmp_path


def test_images_beside_a_mask_need_no_capture_file(folder: Path) -> None:
    mirror = load_mirror(folder)
    assert mirror.names == ("a.png", "b.png")
    np.testing.assert_allclose(mirror.spheres[0].circle, (*CENTRE, RADIUS), atol=0.03)
    assert mirror.spheres[0].camera.orthographic


def test_a_capture_of_a_sphere_needs_no_lights(folder: Path) -> None:
    text = 'mask = "mask.png"\n[geometry]\nshape = "sphere"\n[encoding]\nsaturation = 0.5\n[[image]]\nfile = "b.png"\n'
    (folder / "capture.toml").write_text(text + "[camera]\nkind = 'perspective'\nfov_y = 0.4\n")
    mirror = load_mirror(folder / "capture.toml")
    assert mirror.names == ("b.png",)
    assert mirror.encoding.saturation == 0.5
    assert mirror.spheres[0].camera.fov_y == 0.4
    assert load_mirror(folder, fov_y=0.3).spheres[0].camera.fov_y == 0.3


def test_a_circle_that_is_given_wins_over_that_of_the_files(folder: Path) -> None:
    circles = [(20.0, 30.0, 10.0), (60.0, 30.0, 15.0)]
    assert [sphere.circle for sphere in load_mirror(folder, circles).spheres] == circles
    lines = "[geometry]\nshape = 'sphere'\ncentre = [40, 41]\nradius = 20\n[[image]]\nfile = 'a.png'\n"
    (folder / "capture.toml").write_text(lines)
    assert load_mirror(folder).spheres[0].circle == (40, 41, 20)
    assert load_mirror(folder, circles[:1]).spheres[0].circle == circles[0]


def test_circles_of_psbox_count_from_the_lower_edge_and_their_reference_is_no_photograph(folder: Path) -> None:
    (folder / "circle_data.txt").write_text("45.5\n30.0\n25\n")
    put_image(folder / "ref.png", np.zeros(SHAPE, np.uint8))
    mirror = load_mirror(folder)
    assert mirror.names == ("a.png", "b.png")
    assert mirror.spheres[0].circle == (45.5, 50.0, 25.0)


def test_a_mask_with_two_discs_shows_two_spheres_from_left_to_right(folder: Path) -> None:
    discs = [disc((80, 160), centre, radius, 8) for centre, radius in (((115.0, 40.0), 32.0), ((40.0, 45.0), 25.0))]
    for name in ("b.png", "a.png"):
        put_image(folder / name, np.zeros((80, 160), np.uint8))
    mask = np.round(255 * np.maximum(*discs)).astype(np.uint8)
    mask[2:4, 2:4] = 255
    put_image(folder / "mask.png", mask)
    left, right = load_mirror(folder).spheres
    np.testing.assert_allclose(left.circle, (40.0, 45.0, 25.0), atol=0.05)
    np.testing.assert_allclose(right.circle, (115.0, 40.0, 32.0), atol=0.05)


def test_without_a_mask_the_circle_is_the_edge_in_the_photographs(folder: Path) -> None:
    (folder / "mask.png").unlink()
    ball = np.round(200 * disc(SHAPE, CENTRE, RADIUS, 8)).astype(np.uint8)
    for name in ("b.png", "a.png"):
        put_image(folder / name, ball)
    mirror = load_mirror(folder)
    assert mirror.outline_seen
    np.testing.assert_allclose(mirror.spheres[0].circle, (*CENTRE, RADIUS), atol=0.3)
    # No better than a circle that is read off.
    assert (np.diag(mirror.spheres[0].covariance) >= 0.25).all()


def test_black_and_flat_frames_of_a_matte_sphere_are_taken_off_and_divided_out(folder: Path) -> None:
    flat = np.linspace(0.5, 1, SHAPE[1])[None].repeat(SHAPE[0], 0)
    put_image(folder / "a.png", np.round(255 * (0.1 + 0.4 * flat)).astype(np.uint8))
    np.save(folder / "flat.npy", flat.astype(np.float32))
    text = 'mask = "mask.png"\n[geometry]\nshape = "sphere"\n[encoding]\nblack = 0.1\nflat = "flat.npy"\n'
    (folder / "capture.toml").write_text(text + '[[image]]\nfile = "a.png"\nexposure = 2.0\n')
    pixels = np.array([0, 50, 4000])
    np.testing.assert_allclose(load_mirror(folder).radiance(0, pixels), 0.2, atol=0.005)


def test_folders_that_cannot_be_used_are_refused(folder: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    assert refusal(lambda: load_mirror(empty)).startswith(f"{empty}: no photographs")
    assert refusal(lambda: load_mirror(tmp_path / "nowhere")).startswith(f"{tmp_path / 'nowhere'}: no such folder")
    assert "has its centre outside the 100×80 images" in refusal(lambda: load_mirror(folder, [(500.0, 20.0, 20.0)]))
    assert "--fov-y must lie between" in refusal(lambda: load_mirror(folder, fov_y=-1.0))
    (folder / "circle_data.txt").write_text("45.5\n30.0\n")
    assert "circle_data.txt: expected three numbers" in refusal(lambda: load_mirror(folder))
    (folder / "circle_data.txt").unlink()
    (folder / "mask.png").unlink()
    message = refusal(lambda: load_mirror(folder))
    assert message.startswith(f"{folder}: no circle: neither a mask nor")
    assert "--circle X,Y,R" in message
