"""Everything that matest reads, each with small files as they should be and what reads them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from matest.benchmark.instruments import specimens
from matest.benchmark.instruments.damage import (
    OF_BYTES,
    OF_TEXT,
    checked,
    flipped,
    renumbered,
    revalued_glb,
    revalued_json,
    revalued_toml,
    with_checksums,
)
from matest.benchmark.instruments.endurance import Files, Reader
from matest.benchmark.instruments.image_specimens import IMAGES

_JSON = (*OF_TEXT, *3 * (revalued_json,))


def _images(maker: Any, file: str) -> list[Files]:
    return [{file: content} for content in maker()]


def _image(file: str, folder: Path) -> Iterable[Any]:
    from matest.photographs.images import read_image_file

    image = read_image_file(folder / file)
    yield image.pixels
    if image.coverage is not None:
        yield image.coverage


def _capture(folder: Path) -> Iterable[Any]:
    from matest.capture import load_capture

    return _of_scene(load_capture(folder).scene)


def _scene(folder: Path) -> Iterable[Any]:
    from matest.simulate import load_scene

    return _of_scene(load_scene(folder).scene)


def _of_scene(scene: Any) -> Iterable[Any]:
    yield scene.surface.normals
    yield scene.ambient
    for light in (light for lights in scene.lights for light in lights):
        yield from light.at(scene.surface.positions)


def _camera(folder: Path) -> Iterable[Any]:
    from matest.capture.camera_file import with_camera
    from matest.capture.description import describe
    from matest.capture.geometry import camera_of
    from matest.capture.schema import CaptureFile

    description, _ = with_camera(describe(folder, CaptureFile), (40, 60))
    table = description.tables.camera
    assert table is not None
    camera_of(table, str(description.file))
    return table.position, table.target, table.up, table.matrix, table.distortion


def _mirror(folder: Path) -> Iterable[Any]:
    from matest.capture.mirrors import load_mirror

    return [sphere.circle for sphere in load_mirror(folder).spheres]


def _surface(file: str, folder: Path) -> Iterable[Any]:
    from matest.errors import errors_of
    from matest.scene.camera import Camera
    from matest.scene.mesh import Mesh
    from matest.scene.surface import from_mesh

    path = folder / file
    mesh = Mesh.load(path)
    with errors_of(path):
        surface = from_mesh(mesh, Camera(height=3.0), (specimens.SIDE, specimens.SIDE), None, np.float32)
    yield from (mesh.vertices, surface.normals, surface.positions, mesh.extent, mesh.convex)


def _table(file: str, folder: Path) -> Iterable[Any]:
    from matest.tables import load_table

    table = load_table(folder / file)
    return table.wi, table.wo, table.values


def _optics(folder: Path) -> Iterable[Any]:
    import torch

    from matest.errors import errors_of
    from matest.spectra import optical_constants

    with errors_of(folder / "a.txt"):
        return optical_constants(folder / "a.txt").at(torch.tensor([0.45, 0.55]))


def _material(folder: Path) -> Iterable[Any]:
    import torch

    from matest.estimation.result import load_material

    material = load_material(folder)
    directions = torch.nn.functional.normalize(torch.tensor([[0.1, 0.2, 0.9], [0.7, 0.1, 0.3]]).double(), dim=-1)
    return [material(directions, directions.flip(0)).detach()]


def _result(folder: Path) -> Iterable[Any]:
    from matest.estimation.result import read_result
    from matest.report.folder import check_destination

    content = read_result(folder)
    check_destination(folder, "result.json")
    stds = (np.ravel(parameter.get("std")) for parameter in content["parameters"].values())
    return [[value for value in std if value is not None] for std in stds]


def _prediction(folder: Path) -> Iterable[Any]:
    from matest.report.folder import check_destination

    check_destination(folder, "prediction.json")
    return ()


def _map(folder: Path) -> Iterable[Any]:
    from matest.report.maps import load_maps

    for each in load_maps(folder, specimens.map_surface()).values():
        yield each.status


def _checkpoint(folder: Path) -> Iterable[Any]:
    from matest.training.checkpoint import read_checkpoint

    read_checkpoint(folder / "a.safetensors")
    return ()


def _image_readers() -> Sequence[Reader]:
    behind_checksums = partial(checked, flipped, with_checksums), partial(checked, renumbered, with_checksums)
    return [
        Reader(
            name,
            file,
            partial(_images, maker, file),
            partial(_image, file),
            damages=(*OF_BYTES, *behind_checksums) if name == "PNG" else OF_BYTES,
        )
        for name, (file, maker) in IMAGES.items()
    ]


READERS: tuple[Reader, ...] = (
    *_image_readers(),
    Reader("capture.toml", "capture.toml", specimens.captures, _capture, (*OF_TEXT, *3 * (revalued_toml,)), cost=10),
    Reader("scene.toml", "scene.toml", specimens.scenes, _scene, (*OF_TEXT, *3 * (revalued_toml,)), cost=10),
    Reader(".lp", "a.lp", specimens.light_list, _capture, OF_TEXT, cost=10),
    Reader(".dome", "a.dome", specimens.domes, _capture, _JSON, cost=10),
    Reader("DiLiGenT directions", "light_directions.txt", specimens.diligent, _capture, OF_TEXT, cost=10),
    Reader("DiLiGenT intensities", "light_intensities.txt", specimens.diligent, _capture, OF_TEXT, cost=10),
    Reader("DiLiGenT names", "filenames.txt", specimens.diligent, _capture, OF_TEXT, cost=10),
    Reader("circle_data.txt", "circle_data.txt", specimens.circles, _mirror, OF_TEXT, cost=5),
    Reader("transforms.json", "transforms.json", specimens.transforms, _camera, _JSON, cost=5),
    Reader("COLMAP cameras.txt", "cameras.txt", specimens.colmap_text, _camera, OF_TEXT, cost=5),
    Reader("COLMAP images.txt", "images.txt", specimens.colmap_text, _camera, OF_TEXT, cost=5),
    Reader("COLMAP cameras.bin", "cameras.bin", specimens.colmap_binary, _camera, cost=5),
    Reader("COLMAP images.bin", "images.bin", specimens.colmap_binary, _camera, cost=5),
    Reader(
        "PLY", "a.ply", partial(specimens.meshes, "ply", {}, {"encoding": "ascii"}), partial(_surface, "a.ply"), cost=5
    ),
    Reader("OBJ", "a.obj", specimens.objects, partial(_surface, "a.obj"), OF_TEXT, cost=5),
    Reader("STL", "a.stl", specimens.stls, partial(_surface, "a.stl"), cost=5),
    Reader("GLB", "a.glb", specimens.gltf, partial(_surface, "a.glb"), (*OF_BYTES, *4 * (revalued_glb,)), cost=5),
    Reader("OFF", "a.off", partial(specimens.meshes, "off"), partial(_surface, "a.off"), OF_TEXT, cost=5),
    Reader("CSV table", "a.csv", specimens.csv_tables, partial(_table, "a.csv"), OF_TEXT, cost=2),
    Reader("Cornell .brdf", "a.brdf", specimens.cornell, partial(_table, "a.brdf"), OF_TEXT),
    Reader("MERL .binary", "a.binary", specimens.merl, partial(_table, "a.binary"), cost=1000, megabytes=256),
    Reader("optical constants", "a.txt", specimens.constants, _optics, OF_TEXT),
    Reader("material.json", "material.json", specimens.materials, _material, _JSON, cost=2),
    Reader("result.json", "result.json", specimens.results, _result, _JSON),
    Reader("prediction.json", "prediction.json", specimens.predictions, _prediction, _JSON),
    Reader("maps: values", "maps/albedo.exr", specimens.maps, _map),
    Reader("maps: normals", "maps/normals.png", specimens.maps, _map),
    Reader("checkpoint", "a.safetensors", specimens.checkpoints, _checkpoint, (*OF_BYTES, OF_TEXT[0])),
)
