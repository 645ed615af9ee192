"""Texture coordinates: a texel is one place on the mesh, and files have what the atlas has."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from matest.export.atlas import Atlas, atlas_of
from matest.scene.mesh import Mesh
from tests.captures import refusal
from tests.export.two_tone import vase


@pytest.fixture(scope="module")
def unwrapped() -> Atlas:
    pytest.importorskip("xatlas")
    return atlas_of(vase(), "result")


def test_texture_coordinates_of_the_mesh_are_kept() -> None:
    atlas = atlas_of(vase(texture=True), "result")
    np.testing.assert_array_equal(atlas.corner_uv, vase(texture=True).corner_uv)
    assert atlas.origin == "texture coordinates of the mesh"


def test_a_texel_lies_where_its_texture_coordinate_says() -> None:
    atlas = atlas_of(vase(texture=True), "result")
    texels = atlas.texels(64)
    uv = texels.mixed(atlas.corner_uv)
    np.testing.assert_allclose(64 * uv[:, 0] - 0.5, texels.places % 64, atol=1e-3)
    np.testing.assert_allclose(64 * (1 - uv[:, 1]) - 0.5, texels.places // 64, atol=1e-3)
    # By the mesh's own formula: u goes around it, v along it.
    points = texels.mixed(atlas.mesh.triangles)
    np.testing.assert_allclose(points[:, 1], 2 * (uv[:, 1] - 0.02) / 0.96 - 1, atol=1e-9)
    angle = np.arctan2(points[:, 0], points[:, 2]) / (2 * np.pi) % 1
    np.testing.assert_allclose(angle, (uv[:, 0] - 0.02) / 0.96 % 1, atol=1e-3)


def test_texels_of_an_unwrapped_mesh_stand_for_its_area(unwrapped: Atlas) -> None:
    assert unwrapped.origin == "the mesh has no texture coordinates: unwrapped by xatlas"
    texels = unwrapped.texels(256)
    # Some faces are smaller than a texel.
    whole = trimesh.Trimesh(vase().vertices, vase().faces).area
    assert unwrapped.texel_area(texels).sum() == pytest.approx(whole, rel=1e-3)
    # A texel as wide as stated: the texture has so many of them on the surface.
    width = unwrapped.area.sum() ** 0.5 / 100
    size = round(unwrapped.resolution(width))
    assert len(unwrapped.texels(size)) == pytest.approx(100**2, rel=0.01)


def test_no_place_of_an_unwrapped_mesh_shares_a_texel(unwrapped: Atlas) -> None:
    again = atlas_of(Mesh(vase().vertices, vase().faces), "result")
    again.mesh.corner_uv = unwrapped.corner_uv
    assert atlas_of(again.mesh, "result").origin == "texture coordinates of the mesh"


@pytest.mark.parametrize(
    ("change", "clause"),
    [
        (lambda uv: 1.5 * uv, "the texture coordinates of the mesh leave the square from 0 to 1"),
        (lambda uv: np.abs(2 * uv - 1), "parts of the mesh share texture coordinates"),
        (lambda uv: 0 * uv + 0.5, "the texture coordinates of the mesh leave a part of it without texels"),
    ],
    ids=["repeated", "mirrored", "collapsed"],
)
def test_texture_coordinates_that_do_not_serve_are_made_anew(change, clause: str) -> None:  # type: ignore[no-untyped-def]
    pytest.importorskip("xatlas")
    mesh = Mesh(vase().vertices, vase().faces)
    corner_uv = vase(texture=True).corner_uv
    assert corner_uv is not None
    mesh.corner_uv = change(corner_uv)
    assert atlas_of(mesh, "result").origin == f"{clause}: unwrapped by xatlas"


def test_without_xatlas_a_mesh_to_unwrap_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xatlas", None)
    message = refusal(lambda: atlas_of(vase(), "vase/matest"))
    assert message.startswith("vase/matest: the mesh has no texture coordinates, and xatlas")
    assert 'pip install "matest-brdf[uv]"' in message


def test_the_file_of_the_mesh_has_its_corners(unwrapped: Atlas, tmp_path: Path) -> None:
    unwrapped.save(tmp_path / "mesh.obj")
    mesh = trimesh.load(tmp_path / "mesh.obj", process=False)
    np.testing.assert_allclose(mesh.triangles, vase().triangles, atol=1e-6)
    np.testing.assert_allclose(mesh.visual.uv[mesh.faces], unwrapped.corner_uv, atol=1e-6)
    normals = vase().corner_normals / np.linalg.norm(vase().corner_normals, axis=2, keepdims=True)
    np.testing.assert_allclose(mesh.vertex_normals[mesh.faces], normals, atol=1e-5)
    assert "mtllib" not in (tmp_path / "mesh.obj").read_text()
