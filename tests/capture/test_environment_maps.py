"""Maps of light from their files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from matest.capture.environment_maps import EnvironmentMaps, read_environment
from matest.capture.schema import LightTable
from matest.photographs.images import write_image
from tests.captures import refusal

MAP = np.full((8, 16, 3), (3.0, 2.0, 1.0), np.float32)
NEGATIVE, HOLE = MAP.copy(), MAP.copy()
NEGATIVE[2, 3] = -0.5
HOLE[2, 3] = np.nan


def put(folder: Path, image: np.ndarray, name: str = "map.exr") -> Path:
    write_image(folder / name, image)
    return folder / name


@pytest.mark.parametrize(
    ("image", "name", "expected"),
    [
        (MAP[:, :10], "map.exr", "twice as wide as high; got 10×8 pixels"),
        (NEGATIVE, "map.exr", "no negative radiance; got -0.5"),
        (HOLE, "map.exr", "map.exr"),
        (0 * MAP, "map.exr", "dark everywhere"),
        (MAP.astype(np.uint8), "map.png", "holds radiance, floats (EXR, HDR); got integers"),
    ],
)
def test_maps_that_cannot_be_used_are_refused(tmp_path: Path, image: np.ndarray, name: str, expected: str) -> None:
    file = put(tmp_path, image, name)
    message = refusal(lambda: read_environment(file, 3))
    assert expected in message
    assert str(file) in message


def test_grey_photographs_take_the_mean_of_a_map_and_grey_maps_serve_all(tmp_path: Path) -> None:
    assert torch.equal(read_environment(put(tmp_path, MAP), 1), torch.full((8, 16, 1), 2.0, dtype=torch.float64))
    grey = read_environment(put(tmp_path, MAP[..., 1], "grey.npy"), 3)
    assert torch.equal(grey, torch.full((8, 16, 3), 2.0, dtype=torch.float64))


def test_a_map_is_read_once_and_scaled_and_turned(tmp_path: Path) -> None:
    put(tmp_path, MAP)
    reads = []

    def locate(name: str, key: str) -> Path:
        reads.append(key)
        return tmp_path / name

    maps = EnvironmentMaps(locate, 3, None)
    first = maps.light(LightTable(environment="map.exr", scale=2.0, directions=32), "image 0, light 0")
    second = maps.light(LightTable(environment="map.exr", scale=2.0, directions=32, turn=0.5), "image 1, light 0")
    assert reads == ["image 0, light 0: environment"]
    assert second.environment is first.environment
    assert second.turn == 0.5
    assert first.nodes == 33
    torch.testing.assert_close(first.power, 8 * torch.pi * torch.tensor([3.0, 2.0, 1.0], dtype=torch.float64))
