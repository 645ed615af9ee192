from __future__ import annotations

from pathlib import Path

import pytest

from matest.capture.formats import folder
from tests.captures import refusal


def touch(place: Path, *names: str) -> None:
    for name in names:
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).touch()


def test_photographs_are_all_images_but_mask_and_normals(tmp_path: Path) -> None:
    touch(tmp_path, "b.png", "A.JPG", "mask.png", "Normal_gt.png", "normals.exr", ".hidden.png", "list.lp", "x.mat")
    assert [file.name for file in folder.images(tmp_path)] == ["A.JPG", "b.png"]


def test_numbers_in_names_make_the_order_clear_or_not(tmp_path: Path) -> None:
    touch(tmp_path, "08.png", "09.png", "10.png")
    assert [file.name for file in folder.images_in_order(tmp_path / "x.dome", 3)] == ["08.png", "09.png", "10.png"]
    touch(tmp_path, "7.png")
    assert "leading zeros" in refusal(lambda: folder.images_in_order(tmp_path / "x.dome", 4))


@pytest.mark.parametrize("name", ["a.jpg", "A.JPG", r"C:\rti\a.jpg", "/home/x/a.jpg", r"..\jpeg\a.jpg"])
def test_a_photograph_is_found_by_the_last_part_of_its_path(tmp_path: Path, name: str) -> None:
    touch(tmp_path, "a.jpg")
    assert folder.image_named(tmp_path / "x.lp", name, 2) == "a.jpg"


def test_a_photograph_beside_the_list_comes_before_one_elsewhere(tmp_path: Path) -> None:
    touch(tmp_path, "lists/a.jpg", "a.jpg", "b.jpg")
    for name in ("../a.jpg", str(tmp_path / "a.jpg")):
        assert folder.image_named(tmp_path / "lists" / "x.lp", name, 2) == "a.jpg"
    message = refusal(lambda: folder.image_named(tmp_path / "lists" / "x.lp", "../b.jpg", 2))
    assert "line 2 names 'b.jpg'" in message


def test_a_folder_in_a_path_counts_where_it_is_there(tmp_path: Path) -> None:
    touch(tmp_path, "jpeg/a.jpg", "a.jpg")
    assert folder.image_named(tmp_path / "x.lp", r"C:\rti\jpeg\a.jpg", 2) == "jpeg/a.jpg"
    assert folder.image_named(tmp_path / "x.lp", "a.jpg", 2) == "a.jpg"


def test_geometry_is_a_normal_map_or_a_mesh_before_a_sphere(tmp_path: Path) -> None:
    touch(tmp_path, "mask.png")
    assert folder.geometry(tmp_path).shape == "sphere"
    touch(tmp_path, "vase.ply")
    assert folder.geometry(tmp_path).mesh == "vase.ply"
    touch(tmp_path, "normals.png")
    assert folder.geometry(tmp_path).normals == "normals.png"


def test_several_meshes_are_refused(tmp_path: Path) -> None:
    touch(tmp_path, "a.ply", "b.obj")
    assert "expected one mesh; got a.ply, b.obj" in refusal(lambda: folder.geometry(tmp_path))


def test_a_mask_is_no_sphere_where_the_layout_has_none(tmp_path: Path) -> None:
    touch(tmp_path, "mask.png")
    assert "or a mesh into the folder" in refusal(lambda: folder.geometry(tmp_path, spheres=False))
