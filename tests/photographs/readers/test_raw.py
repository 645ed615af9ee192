from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from matest.photographs.images import read_image, read_image_file
from tests.captures import CaptureFolder, refusal
from tests.photographs.raw_files import RGGB, write_dng

pytest.importorskip("rawpy", reason="needs matest-brdf[raw]")

HEIGHT, WIDTH = 24, 32
WHITE = 4095
PATTERNS = {"RGGB": RGGB, "BGGR": (2, 1, 1, 0), "GRBG": (1, 0, 2, 1), "GBRG": (1, 2, 0, 1)}


def counts(low: int = 70, high: int = 4000, shape: tuple[int, int] = (HEIGHT, WIDTH)) -> np.ndarray:
    return np.random.default_rng(17).integers(low, high, shape).astype(np.uint16)


def binned(stored: np.ndarray, pattern: tuple[int, ...], black: tuple[int, ...]) -> np.ndarray:
    """Red, mean green and blue of every two by two pixels, one block at a time."""
    black = black if len(black) == 4 else 4 * black
    out = np.empty((HEIGHT // 2, WIDTH // 2, 3))
    for row, column in np.ndindex(out.shape[:2]):
        block = stored[2 * row : 2 * row + 2, 2 * column : 2 * column + 2].ravel().astype(float)
        fractions = (block - black) / (WHITE - np.array(black, float))
        out[row, column] = [np.mean([f for f, c in zip(fractions, pattern, strict=True) if c == k]) for k in range(3)]
    return out


@pytest.mark.parametrize("black", [(0,), (64,), (64, 65, 66, 67)], ids=["none", "one", "four"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_two_by_two_pixels_become_one_between_black_and_white(tmp_path: Path, pattern: str, black: tuple[int, ...]):
    path = write_dng(tmp_path / "a.dng", counts(), PATTERNS[pattern], black=black)
    file = read_image_file(path)
    assert file.pixels.dtype == np.float32
    np.testing.assert_allclose(file.pixels, binned(counts(), PATTERNS[pattern], black), atol=2e-7)
    assert len(file.notes) == 1
    assert "half the size" in file.notes[0]


def test_counts_below_black_stay_negative(tmp_path: Path) -> None:
    image = read_image(write_dng(tmp_path / "a.dng", counts(40, 80), black=(64,)))
    assert image.min() < 0


def test_a_saturated_green_saturates_the_mean_of_both(tmp_path: Path) -> None:
    stored = counts(high=2000)
    stored[4, 7], stored[10, 10], stored[12, 15] = 4095, 4200, 4095
    image = read_image(write_dng(tmp_path / "a.dng", stored))
    assert [tuple(place) for place in np.argwhere(image == 1).tolist()] == [(2, 3, 1), (5, 5, 0), (6, 7, 1)]
    assert image.max() == 1


@pytest.mark.parametrize(("tag", "turns"), [(1, 0), (3, 2), (6, 3), (8, 1)])
def test_pixels_are_turned_as_the_camera_asks(tmp_path: Path, tag: int, turns: int) -> None:
    image = read_image(write_dng(tmp_path / "a.dng", counts(), orientation=tag))
    np.testing.assert_allclose(image, np.rot90(binned(counts(), RGGB, (0,)), turns), atol=2e-7)


def test_odd_edges_are_left_out(tmp_path: Path) -> None:
    stored = np.pad(counts(), ((0, 1), (0, 1)))
    image = read_image(write_dng(tmp_path / "a.dng", stored))
    np.testing.assert_allclose(image, binned(counts(), RGGB, (0,)), atol=2e-7)


def test_the_exposure_is_time_times_iso_over_the_square_of_the_opening(tmp_path: Path) -> None:
    path = write_dng(tmp_path / "a.dng", counts(), time=(1, 50), sensitivity=400, opening=(56, 10))
    assert read_image_file(path).exposure == pytest.approx(4 / 50 / 5.6**2, rel=1e-6)
    assert read_image_file(write_dng(tmp_path / "b.dng", counts())).exposure is None


def filled(folder: CaptureFolder, exposures: tuple[float, float]) -> CaptureFolder:
    """The capture with its images, of radiance up to 1, as RAW of some relative exposures."""
    for k, (table, exposure) in enumerate(zip(folder.tables["image"], exposures, strict=True)):
        radiance = exposure * np.load(folder.path / table["file"]).repeat(2, axis=0).repeat(2, axis=1)
        mosaic = radiance[..., 1].copy()
        mosaic[::2, ::2], mosaic[1::2, 1::2] = radiance[::2, ::2, 0], radiance[1::2, 1::2, 2]
        table["file"] = f"{k}.dng"
        time = (1, round(100 / exposure))
        write_dng(folder.path / f"{k}.dng", np.round(64 + 4000 * mosaic).astype(np.uint16), black=(64,), time=time)
    return folder


def test_a_capture_takes_the_exposures_of_its_files(folder: CaptureFolder) -> None:
    plain = folder.load()
    capture = filled(folder, (0.5, 1.0)).load()
    assert capture.photographs.exposures == pytest.approx((1, 2), rel=1e-6)
    assert any("1 to 2 of the first image's" in note for note in capture.photographs.notes)
    for image in range(2):
        np.testing.assert_allclose(
            capture.radiance(image) * 2 * 4031 / 4000, plain.radiance(image), atol=1.1 / 4000 * 2
        )


def test_exposures_that_the_capture_states_hold(folder: CaptureFolder) -> None:
    filled(folder, (0.5, 1.0)).tables["image"][1]["exposure"] = 3.0
    capture = folder.load()
    assert capture.photographs.exposures == (1, 3)
    assert not any("first image's" in note for note in capture.photographs.notes)


def test_like_exposures_need_no_note(folder: CaptureFolder) -> None:
    capture = filled(folder, (0.5, 0.5)).load()
    assert capture.photographs.exposures == (1, 1)
    assert not any("first image's" in note for note in capture.photographs.notes)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_a_truncated_file_is_refused(tmp_path: Path, share: float) -> None:
    path = write_dng(tmp_path / "a.dng", counts())
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    message = refusal(lambda: read_image(path))
    assert message.startswith(f"{path}: ")
    assert "LibRaw says" in message


def test_what_is_no_raw_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.nef").write_text("no picture", "utf-8")
    assert "LibRaw says" in refusal(lambda: read_image(tmp_path / "a.nef"))


def test_other_colour_filters_are_refused(tmp_path: Path) -> None:
    rows = ["GBGGRG", "RGRBGB", "GBGGRG", "GRGGBG", "BGBRGR", "GRGGBG"]
    pattern = tuple("RGB".index(letter) for row in rows for letter in row)
    path = write_dng(tmp_path / "a.dng", counts(shape=(36, 36)), pattern, dimensions=(6, 6))
    assert "Bayer" in refusal(lambda: read_image(path))


def test_a_black_above_white_is_refused(tmp_path: Path) -> None:
    assert "black levels" in refusal(lambda: read_image(write_dng(tmp_path / "a.dng", counts(), black=(5000,))))


def test_without_rawpy_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_dng(tmp_path / "a.dng", counts())
    monkeypatch.setitem(sys.modules, "rawpy", None)
    assert 'pip install "matest-brdf[raw]"' in refusal(lambda: read_image(path))


def test_a_filter_that_rawpy_does_not_know_is_refused(tmp_path: Path) -> None:
    path = write_dng(tmp_path / "a.dng", counts(), (0, 1, 1, 1))
    assert "Bayer" in refusal(lambda: read_image(path))
