from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from matest.capture import schema
from matest.capture.description import describe
from matest.capture.geometry import visible_surface
from matest.photographs.images import read_image, read_image_file, read_mask
from matest.photographs.readers.chromaticities import to_rec709
from tests.captures import SHAPE, CaptureFolder, refusal, sphere_normals

REC_709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
REC_2020 = (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329)
ACES = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
# As published: ITU-R BT.2407 for Rec.2020, the ACES project for its AP0 with Bradford's adaptation.
MATRICES = {
    REC_2020: [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]],
    ACES: [[2.5217, -1.1341, -0.3876], [-0.2765, 1.3727, -0.0962], [-0.0154, -0.1530, 1.1683]],
}


def written(path: Path, image: np.ndarray, chromaticities: tuple[float, ...] | None, names: str = "RGB") -> Path:
    header = {"type": OpenEXR.scanlineimage} | ({} if chromaticities is None else {"chromaticities": chromaticities})
    channels = {name: np.ascontiguousarray(image[..., k], np.float32) for k, name in enumerate(names)}
    OpenEXR.File(header, channels).write(str(path))
    return path


def colours(channels: int = 3) -> np.ndarray:
    return np.random.default_rng(19).uniform(0, 2, (6, 9, channels)).astype(np.float32)


@pytest.mark.parametrize("primaries", MATRICES, ids=["Rec.2020", "ACES"])
def test_matrices_are_the_published_ones(primaries: tuple[float, ...]) -> None:
    matrix = to_rec709(Path("a.exr"), primaries)
    assert matrix is not None
    np.testing.assert_allclose(matrix, MATRICES[primaries], atol=2e-4)
    np.testing.assert_allclose(matrix.sum(axis=1), 1, atol=1e-9)  # white stays white


@pytest.mark.parametrize("primaries", MATRICES, ids=["Rec.2020", "ACES"])
def test_colours_are_converted_and_said_to_be(tmp_path: Path, primaries: tuple[float, ...]) -> None:
    file = read_image_file(written(tmp_path / "a.exr", colours(), primaries))
    np.testing.assert_allclose(file.pixels, colours() @ np.transpose(MATRICES[primaries]), atol=2e-3)
    assert file.pixels.dtype == np.float32
    assert ["Rec.709" in note for note in file.notes] == [True]


@pytest.mark.parametrize("primaries", [None, REC_709])
def test_colours_of_rec709_stay_as_they_are(tmp_path: Path, primaries: tuple[float, ...] | None) -> None:
    file = read_image_file(written(tmp_path / "a.exr", colours(), primaries))
    np.testing.assert_array_equal(file.pixels, colours())
    assert file.notes == ()


@pytest.mark.parametrize("names", ["Y", "XYZ"])
def test_grey_and_vectors_have_no_primaries(tmp_path: Path, names: str) -> None:
    image = colours(len(names))
    np.testing.assert_array_equal(read_image(written(tmp_path / "a.exr", image, ACES, names)), image)


def test_normals_and_masks_are_no_colours(folder: CaptureFolder) -> None:
    written(folder.path / "normals.exr", sphere_normals(), ACES)
    mask = np.zeros((*SHAPE, 3))
    mask[10:20, 10:20] = (0.25, 0.5, 1)
    mask[12:14] /= 2
    written(folder.path / "mask.exr", mask, ACES)
    np.testing.assert_array_equal(read_mask(folder.path / "mask.exr"), mask.max(axis=2))
    folder.tables["geometry"] = {"normals": "normals.exr"}
    surface = visible_surface(describe(folder.save(), schema.CaptureFile), SHAPE)
    np.testing.assert_allclose(surface.normals, sphere_normals().reshape(-1, 3)[surface.pixels], atol=1e-6)


@pytest.mark.parametrize("primaries", [8 * (0.3,), 8 * (0.0,)])
def test_primaries_without_colours_are_refused(tmp_path: Path, primaries: tuple[float, ...]) -> None:
    path = written(tmp_path / "a.exr", colours(), primaries)
    message = refusal(lambda: read_image(path))
    assert message.startswith(f"{path}: ")
    assert "span no colours" in message


@pytest.mark.parametrize(
    "primaries",
    [
        # Two primaries next to one another.
        (*REC_2020[:4], 0.17, 0.797 - 1e-6, *REC_2020[6:]),
        # Of a damaged file: single precision does not hold what comes of it.
        (1.1e-40, 0.0, 9.2e-41, 9.2e-41, 2.4e21, 4.6e27, 4.3e21, 6.9e22),
    ],
)
@pytest.mark.filterwarnings("error")
def test_colours_that_the_conversion_makes_immense_are_refused(tmp_path: Path, primaries: tuple[float, ...]) -> None:
    file = written(tmp_path / "a.exr", 1e14 * colours(), primaries)
    assert "larger ones" in refusal(lambda: read_image(file))
