"""The folder of plain textures: what is in its files, read without matest."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import trimesh

from matest.brdf import Lambert
from matest.export.textured import write_folder
from tests.export.two_tone import STD, textured, to_edge, truth


def pixels(file: Path) -> np.ndarray:
    return OpenEXR.File(str(file)).channels()["RGB"].pixels


def test_the_files_have_values_error_bars_and_status_of_every_texel(tmp_path: Path) -> None:
    made = textured(Lambert(0.5), "albedo")
    files = write_folder(made, tmp_path / "textures")
    names = ["albedo.exr", "albedo_std.exr", "albedo_status.png", "mesh.obj"]
    assert [file.name for file in files] == names
    assert sorted(file.name for file in (tmp_path / "textures").iterdir()) == sorted(names)
    value, std = pixels(files[0]), pixels(files[1])
    status = cv2.imread(str(files[2]), cv2.IMREAD_UNCHANGED)
    assert set(np.unique(status)) == {0, 1}
    mesh = trimesh.load(files[3], process=False)
    u, v = mesh.visual.uv.T
    column, row = np.floor(256 * u).astype(int), np.floor(256 * (1 - v)).astype(int)
    seen = (status[row, column] == 1) & (to_edge(mesh.vertices) > 0.05)
    assert seen.mean() > 0.8
    error = value[row, column][seen] - truth(mesh.vertices[seen])
    assert (np.abs(error) < 1.96 * std[row, column][seen]).mean() > 0.95
    # At the edge of the colours views differ by more than their error bars, and the standard error is larger.
    assert np.median(std[status == 1]) == pytest.approx(STD, rel=0.01)


def test_the_material_at_texels_has_their_values_and_the_mean_elsewhere() -> None:
    made = textured(Lambert(0.5), "albedo")
    place = made.seen[100]
    row, column = divmod(int(place), made.size)
    np.testing.assert_allclose(made.at_texels.parameters["albedo"][place], made.textures["albedo"].value[row, column])
    corner = made.at_texels.parameters["albedo"][0]
    np.testing.assert_allclose(corner, made.material.parameters["albedo"], rtol=1e-6)
