"""Where a file should be there is a pipe, which would be waited for without end, or a device."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

import matest
from matest.capture import schema
from matest.capture.description import describe
from matest.estimation.result import load_material, read_result
from matest.lights.files import check_tables
from matest.photographs.images import read_image
from matest.report.folder import check_destination
from matest.report.maps import load_maps
from matest.scene.mesh import Mesh
from matest.tables import load_table
from matest.training.checkpoint import read_checkpoint
from tests.captures import CaptureFolder, refusal, sphere_surface

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")

# What is a pipe, and what reads it from its folder.
READERS: dict[str, Callable[[Path], object]] = {
    "a.png": lambda folder: read_image(folder / "a.png"),
    "a.ply": lambda folder: Mesh.load(folder / "a.ply"),
    "a.csv": lambda folder: load_table(folder / "a.csv"),
    "a.binary": lambda folder: load_table(folder / "a.binary"),
    "capture.toml": lambda folder: describe(folder, schema.CaptureFile),
    "scene.toml": lambda folder: describe(folder, schema.SceneFile),
    "a.lp": lambda folder: describe(folder / "a.lp", schema.CaptureFile),
    "light_directions.txt": lambda folder: describe(folder, schema.CaptureFile),
    "material.json": load_material,
    "result.json": read_result,
    "prediction.json": lambda folder: check_destination(folder, "prediction.json"),
    "lights.toml": lambda folder: check_tables(folder / "lights.toml"),
    "maps/normals.png": lambda folder: load_maps(folder, sphere_surface()),
    "a.safetensors": lambda folder: read_checkpoint(folder / "a.safetensors"),
}


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_is_not_waited_for(tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    os.mkfifo(tmp_path / name)
    assert str(tmp_path) in refusal(lambda: READERS[name](tmp_path))


@pytest.mark.parametrize("key", ["mask", "image"])
def test_a_pipe_in_a_capture_is_not_waited_for(folder: CaptureFolder, key: str) -> None:
    name = "mask.png" if key == "mask" else "01.npy"
    (folder.path / name).unlink()
    os.mkfifo(folder.path / name)
    assert name in refusal(folder.load)


def test_a_device_is_no_image(folder: CaptureFolder) -> None:
    (folder.path / "01.npy").unlink()
    (folder.path / "01.npy").symlink_to("/dev/zero")
    refusal(folder.load)
    refusal(lambda: matest.load_capture(folder.save(), root=Path("/")))
