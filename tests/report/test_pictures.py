"""Pictures of an estimate."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matest.brdf import Lambert
from matest.capture import Capture
from matest.photographs.images import read_image
from matest.photographs.photometry import Encoding
from matest.report.picture_size import PictureSize
from matest.report.pictures import RESIDUAL_RANGE, write_columns, write_pictures
from matest.samples.residual_scale import NOISE_ALONE, ResidualScale
from matest.shading import render
from tests.captures import changed, directional
from tests.simulated import DIRECTIONS, Studio, coloured

GREY = 224  # of residual pictures where a pixel did not count
LARGE = 750  # side of photographs of which previews are smaller, pixels
TRUTH = Lambert([0.6, 0.5, 0.4])


def capture(brightness: float = 1.0, lights: object = None) -> Capture:
    return Studio(size=24, lights=lights or coloured()[:2]).photograph(TRUTH, brightness=brightness)


def picture(folder: Path, name: str) -> np.ndarray:
    return read_image(folder / "images" / name).astype(int)


def middle(image: np.ndarray) -> list[int]:
    return image[12, 12].tolist()


def test_every_image_has_three_pictures(tmp_path: Path) -> None:
    write_pictures(capture(), TRUTH, tmp_path)
    names = {path.name for path in (tmp_path / "images").iterdir()}
    each = {f"{k:02d}_{kind}.png" for k in range(2) for kind in ("photo", "render", "residual")}
    assert names == {*each, "mean_residual.png"}
    assert picture(tmp_path, "00_photo.png").shape == (24, 24, 3)


def test_the_right_material_looks_like_the_photograph(tmp_path: Path) -> None:
    write_pictures(capture(), TRUTH, tmp_path)
    for number in ("00", "01"):
        photo, model = (picture(tmp_path, f"{number}_{kind}.png") for kind in ("photo", "render"))
        assert np.abs(photo - model).max() <= 1
        assert 200 < photo.max() <= 255


def test_the_mean_residual_shows_what_photographs_have_in_common(tmp_path: Path) -> None:
    bright = capture(1.03)
    write_pictures(bright, TRUTH, tmp_path / "same")
    red = picture(tmp_path / "same", "mean_residual.png")
    # 3 % of the rms brightness and more where the object is brighter: beyond half of the full colour.
    assert red[12, 12, 0] - red[12, 12, 2] > 60
    assert (red[0, 0] == GREY).all()
    stored = bright.photographs.stored
    opposite = changed(capture(), stored=(stored[0], stored[1] * 0.97 / 1.03))
    write_pictures(opposite, TRUTH, tmp_path / "opposite")
    white = picture(tmp_path / "opposite", "mean_residual.png")
    assert white[12, 12].min() > 225


def test_agreement_is_white_and_grey_is_what_did_not_count(tmp_path: Path) -> None:
    photographs = capture()
    write_pictures(photographs, TRUTH, tmp_path)
    residual = picture(tmp_path, "00_residual.png").reshape(-1, 3)
    used = photographs.scene.surface.pixels[photographs.samples().indices(0)]
    assert residual[used].min() >= 254
    assert (np.delete(residual, used, axis=0) == GREY).all()


def test_brighter_photographs_are_red_and_darker_ones_blue(tmp_path: Path) -> None:
    write_pictures(capture(1.05), TRUTH, tmp_path / "bright")
    write_pictures(capture(0.95), TRUTH, tmp_path / "dark")
    red, _, blue = middle(picture(tmp_path / "bright", "00_residual.png"))
    assert red > blue + 30
    red, _, blue = middle(picture(tmp_path / "dark", "00_residual.png"))
    assert blue > red + 30


def clipped(*levels: float) -> Capture:
    """The capture of a sensor that clips each channel at a level."""
    whole = capture()
    stored = tuple(image.clip(max=np.float32(levels)) for image in whole.photographs.stored)
    # Floats are saturated above the limit: what is cut off at it lies a little beyond.
    return changed(whole, stored=stored, encoding=Encoding(saturation=tuple(0.999999 * level for level in levels)))


def test_a_clipped_channel_agrees_with_a_model_that_lies_beyond_the_clip(tmp_path: Path) -> None:
    photographs = clipped(0.3, 9.0, 9.0)
    assert (photographs.photographs.stored[0][:, 0] > 0.29).sum() > 50
    write_pictures(photographs, TRUTH, tmp_path)
    used = photographs.scene.surface.pixels[photographs.samples().indices(0)]
    assert picture(tmp_path, "00_residual.png").reshape(-1, 3)[used].min() >= 254


def test_a_clipped_channel_counts_where_the_model_lies_below_the_clip(tmp_path: Path) -> None:
    write_pictures(clipped(0.3, 9.0, 9.0), Lambert([0.2, 0.5, 0.4]), tmp_path)
    red, _, blue = middle(picture(tmp_path, "00_residual.png"))
    assert red > blue + 30


def test_a_pixel_whose_channels_are_all_clipped_is_grey(tmp_path: Path) -> None:
    write_pictures(clipped(0.3, 0.3, 0.2), TRUTH, tmp_path)
    assert middle(picture(tmp_path, "00_residual.png")) == [GREY] * 3


def test_an_outlier_of_the_fit_is_grey_and_what_counted_is_not(tmp_path: Path) -> None:
    photographs = capture()
    stored = [image.copy() for image in photographs.photographs.stored]
    surface = photographs.scene.surface
    stored[0][surface.pixels == 12 * surface.shape[1] + 12] = 50.0
    spoilt = changed(photographs, stored=tuple(stored))
    write_pictures(spoilt, TRUTH, tmp_path / "fit", residual_scale=NOISE_ALONE)
    assert middle(picture(tmp_path / "fit", "00_residual.png")) == [GREY] * 3
    # Where the model misses that much everywhere, it counted.
    write_pictures(spoilt, TRUTH, tmp_path / "misfit", residual_scale=ResidualScale.uniform(1e6))
    assert middle(picture(tmp_path / "misfit", "00_residual.png")) == [178, 24, 43]


def test_full_colour_is_the_stated_share_of_the_brightness(tmp_path: Path) -> None:
    photographs = capture()
    photo = photographs.radiance(0)
    residual_at = {}
    for share in (1.0, 3.0, 0.5):
        shift = share * RESIDUAL_RANGE * float(np.sqrt(np.mean(photo**2)))
        centre = photographs.scene.surface.image(photo)[12, 12].mean()
        albedo = [rho * (1 - shift / centre) for rho in (0.6, 0.5, 0.4)]
        write_pictures(photographs, Lambert(albedo), tmp_path / str(share))
        residual_at[share] = middle(picture(tmp_path / str(share), "00_residual.png"))
    assert residual_at[1.0] == pytest.approx([178, 24, 43], abs=2)
    assert residual_at[3.0] == [178, 24, 43]
    assert residual_at[0.5] == pytest.approx([(255 + c) / 2 for c in (178, 24, 43)], abs=2)


def test_photograph_and_model_share_one_exposure(tmp_path: Path) -> None:
    write_pictures(capture(), Lambert([0.3, 0.25, 0.2]), tmp_path)
    assert picture(tmp_path, "00_render.png").max() < 0.8 * picture(tmp_path, "00_photo.png").max()


def test_the_profile_has_a_column_per_photograph_and_model(tmp_path: Path) -> None:
    photographs = capture()
    write_pictures(photographs, TRUTH, tmp_path)
    with (tmp_path / "profile.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert list(lines[0]) == ["x", "photo_00", "render_00", "photo_01", "render_01"]
    assert [float(line["x"]) for line in lines] == list(range(24))
    expected = render(photographs.scene, TRUTH).numpy()[1, 12].mean(axis=1)
    np.testing.assert_allclose([float(line["render_01"]) for line in lines], expected, atol=1e-5)
    np.testing.assert_allclose([float(line["photo_01"]) for line in lines], expected, atol=1e-5)


def test_grey_captures_have_pictures(tmp_path: Path) -> None:
    photographs = Studio(size=24, lights=((directional(DIRECTIONS[0], 3.0),),)).photograph(Lambert(0.5))
    write_pictures(photographs, Lambert(0.5), tmp_path)
    assert picture(tmp_path, "00_photo.png").shape[:2] == (24, 24)
    assert picture(tmp_path, "00_residual.png").shape == (24, 24, 3)


def test_an_entirely_dark_image_has_pictures(tmp_path: Path) -> None:
    lights = (coloured()[0], (directional((0.0, 0.0, -1.0), 3.0, 3.0, 3.0),))
    write_pictures(capture(lights=lights), TRUTH, tmp_path)
    assert picture(tmp_path, "01_photo.png").max() == 0
    assert (picture(tmp_path, "01_residual.png") == GREY).all()


@pytest.fixture(scope="module")
def large() -> Capture:
    """A capture so large that a preview shows every third pixel of every third row."""
    return Studio(size=LARGE, lights=coloured()[:1]).photograph(TRUTH, seed=1)


@pytest.fixture(scope="module")
def drawn(large: Capture, tmp_path_factory: pytest.TempPathFactory) -> dict[PictureSize, Path]:
    """The folder of each size of picture, of a material that is not quite that of the photographs."""
    folders = {size: tmp_path_factory.mktemp(size) for size in PictureSize}
    for size, folder in folders.items():
        write_pictures(large, Lambert([0.62, 0.5, 0.4]), folder, size)
    return folders


@pytest.mark.parametrize("kind", ["photo", "render", "residual"])
def test_a_preview_shows_every_nth_pixel_of_the_full_picture(drawn: dict[PictureSize, Path], kind: str) -> None:
    preview, full = (picture(drawn[size], f"00_{kind}.png") for size in (PictureSize.PREVIEW, PictureSize.FULL))
    assert full.shape == (LARGE, LARGE, 3)
    assert preview.shape == (LARGE // 3, LARGE // 3, 3)
    # Exposure and colour scale come from the pixels that a picture shows, so they differ a little.
    assert np.abs(preview - full[1::3, 1::3]).max() <= 2


def test_pictures_that_are_small_already_are_previews_of_themselves(tmp_path: Path) -> None:
    photographs = capture()
    for size in (PictureSize.PREVIEW, PictureSize.FULL):
        write_pictures(photographs, TRUTH, tmp_path / size, size)
    for path in (tmp_path / "full" / "images").iterdir():
        assert path.read_bytes() == (tmp_path / "preview" / "images" / path.name).read_bytes()


def test_the_profile_does_not_depend_on_the_size_of_the_pictures(drawn: dict[PictureSize, Path]) -> None:
    preview, full, none = ((drawn[size] / "profile.csv").read_text("utf-8") for size in PictureSize)
    assert len(full.splitlines()) == 1 + LARGE
    assert preview == full
    assert none == full


def test_without_pictures_there_is_only_the_profile(drawn: dict[PictureSize, Path]) -> None:
    assert [path.name for path in drawn[PictureSize.NONE].iterdir()] == ["profile.csv"]


def test_an_object_thinner_than_the_pixels_of_a_preview_has_pictures(large: Capture, tmp_path: Path) -> None:
    surface = large.scene.surface
    row = surface.pixels // surface.shape[1] == surface.shape[0] // 2
    thin = surface.take(row & (surface.pixels % 3 == 0))
    photographs = replace(
        large.photographs,
        scene=replace(large.scene, surface=thin),
        stored=tuple(stored[np.isin(surface.pixels, thin.pixels)] for stored in large.photographs.stored),
    )
    write_pictures(replace(large, photographs=photographs), TRUTH, tmp_path)
    assert picture(tmp_path, "00_photo.png").max() == 0
    assert (picture(tmp_path, "00_residual.png") == GREY).all()


def test_columns_are_written_side_by_side(tmp_path: Path) -> None:
    write_columns(tmp_path / "a.csv", {"x": np.arange(2), "y": np.array([0.123456789, 1e-9])})
    assert (tmp_path / "a.csv").read_text("utf-8").split() == ["x,y", "0,0.123457", "1,1e-09"]


def test_columns_of_different_lengths_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="zip"):
        write_columns(tmp_path / "a.csv", {"x": np.arange(2), "y": np.arange(3)})
