"""The layout of DiLiGenT against NumPy's, SciPy's and OpenCV's readers."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

import matest
from matest.capture.formats import diligent as layout
from tests.capture.formats.laboratories import INTENSITIES, LIGHTS, codes, diligent, rewrite
from tests.captures import put_image, refusal, sphere_normals
from tests.shared_data import measurement


@pytest.fixture
def laboratory(tmp_path: Path) -> Path:
    diligent(tmp_path)
    return tmp_path


def independently(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Directions, intensities, normals and images of a folder."""
    names = (folder / "filenames.txt").read_text("ascii").split()
    images = [cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED)[..., ::-1] / 65535 for name in names]
    directions = np.loadtxt(folder / "light_directions.txt")
    normals = scipy.io.loadmat(folder / "Normal_gt.mat")["Normal_gt"]
    return directions, np.loadtxt(folder / "light_intensities.txt"), normals, np.array(images)


def assert_read_like(folder: Path) -> None:
    capture = matest.load_capture(folder)
    directions, intensities, normals, images = independently(folder)
    surface = capture.scene.surface
    rows, columns = np.divmod(surface.pixels, surface.shape[1])
    np.testing.assert_allclose(surface.normals, normals[rows, columns], atol=1e-6)
    for k, (light,) in enumerate(capture.scene.lights):
        np.testing.assert_allclose(light.direction, directions[k] / np.linalg.norm(directions[k]), atol=1e-12)
        np.testing.assert_allclose(light.power, intensities[k], rtol=1e-12)
        np.testing.assert_allclose(capture.radiance(k), images[k][rows, columns], atol=1e-6)
    assert capture.relative


def test_a_folder_is_read_as_other_readers_read_it(laboratory: Path) -> None:
    assert_read_like(laboratory)


def test_the_published_figurine_is_read_as_other_readers_read_it(tmp_path: Path) -> None:
    source = measurement("diligent_cat", "filenames.txt").parent
    for file in source.iterdir():
        if file.name not in ("capture.toml", "normals.exr"):
            shutil.copyfile(file, tmp_path / file.name)
    assert_read_like(tmp_path)
    # 40 of its normals at the rim point away from the viewer.
    assert len(matest.load_capture(tmp_path).scene.surface) == 45_160


def test_the_lights_strengths_are_true_up_to_one_factor(laboratory: Path) -> None:
    estimate = matest.estimate(matest.load_capture(laboratory), "lambert")
    # Codes have radiance 1 for full scale, and intensities were irradiances.
    np.testing.assert_allclose(estimate.parameters["albedo"].value, (0.7, 0.5, 0.3), rtol=2e-3)


def test_normals_at_the_rim_may_point_away(laboratory: Path) -> None:
    normals = sphere_normals()
    inside = np.argwhere(normals.any(axis=2))[0]
    normals[tuple(inside)] = (0.0, 0.9, -0.435889894)
    whole = len(matest.load_capture(laboratory).scene.surface)
    scipy.io.savemat(laboratory / "Normal_gt.mat", {"Normal_gt": normals})
    assert len(matest.load_capture(laboratory).scene.surface) == whole - 1


@pytest.mark.parametrize("name", ["normal_gt.mat", "Normals.npy"])
def test_other_spellings_of_the_normals_are_read(laboratory: Path, name: str) -> None:
    (laboratory / "Normal_gt.mat").unlink()
    if name.endswith("mat"):
        scipy.io.savemat(laboratory / name, {"Normal_gt": sphere_normals()})
    else:
        np.save(laboratory / name, sphere_normals().astype(np.float32))
    assert matest.load_capture(laboratory).understood["shape"].startswith(f"normal map {name}")


def test_measured_normals_come_before_their_picture(laboratory: Path) -> None:
    put_image(laboratory / "Normal_gt.png", np.zeros((40, 48, 3), np.uint8))
    assert "Normal_gt.mat" in matest.load_capture(laboratory).understood["shape"]


def test_images_of_eight_bits_have_no_transfer_of_this_layout(laboratory: Path) -> None:
    for k, light in enumerate(LIGHTS):
        put_image(laboratory / f"{k + 1:03d}.png", codes(light, INTENSITIES[k], np.uint8))
    message = refusal(lambda: matest.load_capture(laboratory))
    assert "give --transfer linear" in message
    assert "[encoding]" not in message
    assert matest.load_capture(laboratory, transfer="linear").understood["transfer"] == "linear, integers of 8 bits"


def test_a_folder_without_file_names_goes_by_order(laboratory: Path) -> None:
    named = matest.load_capture(laboratory)
    (laboratory / "filenames.txt").unlink()
    ordered = matest.load_capture(laboratory)
    assert ordered.names == named.names
    assert any("go by the images' order" in note for note in ordered.photographs.notes)


def test_views_are_captures_of_their_own(tmp_path: Path) -> None:
    for view in ("view_01", "view_02"):
        (tmp_path / view).mkdir()
        diligent(tmp_path / view)
    message = refusal(lambda: matest.load_capture(tmp_path))
    assert "holds 2 views" in message
    assert str(tmp_path / "view_01") in message
    assert len(matest.load_capture(tmp_path / "view_02")) == len(LIGHTS)


def test_equal_lights_are_said_where_no_intensities_are(laboratory: Path) -> None:
    (laboratory / "light_intensities.txt").unlink()
    capture = matest.load_capture(laboratory)
    assert any("without light_intensities.txt" in note for note in capture.photographs.notes)
    assert capture.relative


def test_any_of_its_files_names_the_folder(laboratory: Path) -> None:
    files = layout.LAYOUT.find(laboratory)
    assert [file.name for file in files] == ["light_directions.txt", "light_intensities.txt", "filenames.txt"]
    assert layout.LAYOUT.find(laboratory / "filenames.txt") == files
    assert layout.LAYOUT.find(laboratory / "mask.png") == ()


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("light_directions.txt", "0.9", "abc", "should hold the direction x y z"),
        ("light_intensities.txt", "1.2000", "-1", "light 1 must be positive"),
        ("filenames.txt", "002.png", "001.png", "names 001.png twice"),
        ("filenames.txt", "002.png", "102.png", "line 2 names '102.png', and there is no such file"),
        ("filenames.txt", "002.png\n", "", "expected 5 names"),
    ],
)
def test_lists_that_do_not_fit_are_refused(laboratory: Path, file: str, old: str, new: str, words: str) -> None:
    rewrite(laboratory / file, lambda text: text.replace(old, new, 1))
    message = refusal(lambda: matest.load_capture(laboratory))
    assert words in message
    assert str(laboratory / file) in message


def test_a_direction_of_zero_is_refused(laboratory: Path) -> None:
    np.savetxt(laboratory / "light_directions.txt", np.zeros((len(LIGHTS), 3)))
    assert "light 1 is 0 0 0" in refusal(lambda: matest.load_capture(laboratory))


def test_missing_directions_and_normals_are_named(laboratory: Path) -> None:
    (laboratory / "Normal_gt.mat").unlink()
    assert "put a normal map" in refusal(lambda: matest.load_capture(laboratory))
    (laboratory / "light_directions.txt").unlink()
    assert "expected light_directions.txt beside" in refusal(lambda: matest.load_capture(laboratory))


def test_what_is_unusual_in_a_folder_is_said(laboratory: Path) -> None:
    usual = matest.load_capture(laboratory)
    rewrite(laboratory / "light_directions.txt", lambda text: text.replace(".", ","))
    put_image(laboratory / "preview.png", np.full((40, 48, 3), 90, np.uint8))
    capture = matest.load_capture(laboratory)
    assert capture.scene.lights[0][0].direction.tolist() == usual.scene.lights[0][0].direction.tolist()
    added = {*capture.photographs.notes} - {*usual.photographs.notes}
    assert added == {
        "light_directions.txt: decimal commas are read as points.",
        "Not in filenames.txt, and so left out: preview.png.",
    }
