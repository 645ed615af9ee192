"""Maps come back from a result folder as they went in, and only for the view that they are of."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

import matest
from matest import InputError
from matest.estimation.parameter_map import ParameterMap, TexelStatus
from matest.photographs.images import read_image, write_image
from matest.report.folder import write_result
from matest.report.maps import load_maps, view_difference, write_maps
from matest.report.picture_size import PictureSize
from matest.scene import Surface
from matest.scene.surface import from_sphere
from tests.estimates import clay
from tests.mapped import mapped, photographs

SIZE = 48


def ball(size: int, radius: float) -> Surface:
    """A sphere in the middle of an image, its radius a share of the side."""
    return from_sphere((size, size), (size / 2, size / 2), radius * size, None)


def surface() -> Surface:
    return photographs().scene.surface


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("maps") / "result"
    write_result(mapped(), photographs(), folder)
    return folder


def test_maps_come_back_as_they_went_in(result: Path) -> None:
    maps, there = load_maps(result, surface()), mapped().maps
    assert [*maps] == [*there] == ["albedo"]
    for part in ("value", "std", "status"):
        expected = getattr(there["albedo"], part)
        torch.testing.assert_close(getattr(maps["albedo"], part), expected, rtol=0, atol=0, equal_nan=True)
    assert load_maps(result / "material.json", surface()).keys() == maps.keys()


def test_a_material_with_the_maps_that_come_back_is_that_of_the_estimate(result: Path) -> None:
    material = matest.with_maps(matest.load_material(result), matest.load_maps(result, surface()))
    for name, value in mapped().material.parameters.items():
        torch.testing.assert_close(material.parameters[name], value, rtol=1e-7, atol=0)


def test_a_few_other_pixels_at_the_rim_take_the_mean(result: Path) -> None:
    smaller = cv2.erode(surface().mask.astype(np.uint8), np.ones((2, 2), np.uint8)).astype(bool)
    assert not smaller.all()
    part = surface().take(smaller.flat[surface().pixels])
    assert len(load_maps(result, part)["albedo"].value) == len(part) < len(surface())
    larger = ball(SIZE, 0.46)
    assert len(larger) > len(surface())
    each = load_maps(result, larger)["albedo"]
    added = ~np.isin(larger.pixels, surface().pixels)
    assert bool((each.status[added] == TexelStatus.UNSEEN).all())
    torch.testing.assert_close(each.filled[added], each.mean.float().expand(int(added.sum()), 1))


def turned(degrees: float) -> Surface:
    angle = np.radians(degrees)
    about_y = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return replace(surface(), normals=surface().normals @ torch.from_numpy(about_y.T).to(surface().normals))


@pytest.mark.parametrize(
    ("other", "sentence"),
    [
        (lambda: ball(64, 0.45), "its maps are of images of 48×48 pixels, and these have 64×64"),
        (lambda: ball(SIZE, 0.3), r"show the object at other pixels \(820 differ\)"),
        (lambda: turned(20), r"show the object from another side \(turned by \d+°\)"),
    ],
    ids=["size", "object", "side"],
)
def test_maps_of_another_view_are_refused_with_the_mend(result: Path, other, sentence: str) -> None:
    with pytest.raises(InputError, match=f"{sentence}: maps belong to the view .* matest.load_material gives"):
        load_maps(result, other())
    assert view_difference(result, surface()) == view_difference(result, turned(0.5)) == ""


def test_a_result_without_maps_has_none(tmp_path: Path) -> None:
    write_result(replace(mapped(), maps={}), photographs(), tmp_path / "out")
    assert load_maps(tmp_path / "out", surface()) == {}
    with pytest.raises(InputError, match="expected a result folder"):
        load_maps(tmp_path / "nowhere", surface())


def test_maps_that_the_result_names_and_the_folder_lacks_are_missed(tmp_path: Path) -> None:
    write_result(mapped(), photographs(), tmp_path / "out")
    shutil.rmtree(tmp_path / "out" / "maps")
    for read in (load_maps, view_difference):
        with pytest.raises(
            InputError, match=r"maps: is missing, while result.json names maps of albedo; copy the whole"
        ):
            read(tmp_path / "out", surface())


@pytest.mark.parametrize("file", ["albedo.exr", "albedo_std.exr", "normals.png"])
def test_a_file_that_is_missing_is_named(tmp_path: Path, file: str) -> None:
    write_maps(mapped(), surface(), tmp_path)
    (tmp_path / "maps" / file).unlink()
    with pytest.raises(InputError, match=rf"{file}: is missing .*estimate with --maps again"):
        load_maps(tmp_path, surface())


def test_a_file_of_another_size_or_of_other_channels_is_named(tmp_path: Path) -> None:
    write_maps(mapped(), surface(), tmp_path)
    std = tmp_path / "maps" / "albedo_std.exr"
    write_image(std, np.repeat(read_image(std), 3, axis=2))
    with pytest.raises(InputError, match=r"albedo_std.exr: expected 1 channel\(s\)"):
        load_maps(tmp_path, surface())
    write_image(std, np.zeros((10, 12, 1), np.float32))
    with pytest.raises(InputError, match=r"albedo_std\.exr: expected 48×48 pixels like normals\.png; got 12×10"):
        load_maps(tmp_path, surface())


def test_every_parameter_with_a_map_has_its_files(tmp_path: Path) -> None:
    count, values = len(surface()), torch.linspace(0.1, 0.6, len(surface()))[:, None]
    status = torch.full((count,), int(TexelStatus.DETERMINED), dtype=torch.uint8)
    maps = {name: ParameterMap(name, values, 0.1 * values, status) for name in ("albedo", "sigma")}
    write_maps(clay(maps=maps), surface(), tmp_path)
    assert [*load_maps(tmp_path, surface())] == ["albedo", "sigma"]


def test_without_pictures_there_are_no_previews(tmp_path: Path) -> None:
    write_result(mapped(), photographs(), tmp_path / "out", pictures=PictureSize.NONE)
    names = {file.name for file in (tmp_path / "out" / "maps").iterdir()}
    assert names == {"albedo.exr", "albedo_std.exr", "albedo_status.png", "normals.png"}
    assert "maps/albedo.png" not in (tmp_path / "out" / "report.html").read_text("utf-8")


def test_renders_and_residuals_of_a_result_are_those_of_the_map(result: Path) -> None:
    render = read_image(result / "images" / "00_render.png").astype(float)
    residual = read_image(result / "images" / "00_residual.png").astype(float)
    left, right = render[SIZE // 2, SIZE // 3], render[SIZE // 2, 2 * SIZE // 3]
    assert (right > 1.2 * left).all()
    # White is agreement: a residual of the mean would be red on one side and blue on the other.
    centre = residual[SIZE // 3 : 2 * SIZE // 3, SIZE // 3 : 2 * SIZE // 3]
    assert abs(centre[..., 0].mean() - centre[..., 2].mean()) < 20
