"""Everything that matest reads, each with small files as they should be and what reads them."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Iterable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

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

# Side of the photographs, in which a sphere has this radius; all lights shine with π.
_SIDE, _RADIUS = 16, 6.5
_LIGHTS = ((0.3, 0.2, 0.9), (-0.5, 0.1, 0.8), (0.1, -0.4, 0.9))
_ALBEDO = 0.5
_MASK = "mask.png"
_PHOTOGRAPHS = tuple(f"{number}.npy" for number in range(len(_LIGHTS)))
_JSON = (*OF_TEXT, *3 * (revalued_json,))


def _encoded(suffix: str, image: np.ndarray) -> bytes:
    import cv2

    return cv2.imencode(suffix, image)[1].tobytes()


def _saved(image: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, image)
    return file.getvalue()


@lru_cache(maxsize=1)
def _sphere() -> dict[str, bytes]:
    """Mask, normals and photographs of a Lambertian sphere."""
    rows, columns = (np.indices((_SIDE, _SIDE)) + 0.5 - _SIDE / 2) / _RADIUS
    # Pixels on the edge are covered in part.
    coverage = np.clip(_RADIUS * (1 - np.hypot(rows, columns)) + 0.5, 0, 1)
    inside = rows**2 + columns**2 < 1
    normals = np.dstack([columns, -rows, np.sqrt(np.clip(1 - rows**2 - columns**2, 0, None))]) * inside[..., None]
    files = {_MASK: _encoded(".png", (255 * coverage).astype(np.uint8)), "normals.npy": _saved(normals)}
    for name, light in zip(_PHOTOGRAPHS, _LIGHTS, strict=True):
        shade = np.clip(normals @ np.array(light) / np.linalg.norm(light), 0, None)
        files[name] = _saved((_ALBEDO * shade).astype(np.float32))
    return files


def _images(maker: Any, file: str) -> list[Files]:
    return [{file: content} for content in maker()]


def _image(file: str, folder: Path) -> Iterable[Any]:
    from matest.photographs.images import read_image_file

    image = read_image_file(folder / file)
    yield image.pixels
    if image.coverage is not None:
        yield image.coverage


def _captures() -> list[Files]:
    images = [{"file": name, "lights": [{"direction": [*light]}]} for name, light in zip(_PHOTOGRAPHS, _LIGHTS, strict=True)]
    near = [{"file": name, "exposure": 0.5, "ambient": 0.01, "lights": [
        {"position": [*(9 * x for x in light)], "intensity": [250.0], "axis": [0.0, 0.0, -1.0], "size": 0.5}
    ]} for name, light in zip(_PHOTOGRAPHS, _LIGHTS, strict=True)]  # fmt: skip
    plain = {"mask": _MASK, "geometry": {"shape": "sphere"}, "image": images}
    full = {
        "mask": _MASK,
        "geometry": {"normals": "normals.npy", "width": 3.0},
        "camera": {"kind": "orthographic", "height": 3.0, "wavelength": [0.55]},
        "encoding": {"transfer": 2.2, "scale": 2.0, "black": 0.01, "saturation": 0.98, "radiometry": "relative"},
        "noise": {"read": 0.002, "gain": 0.0005},
        "uncertainty": {"direction": 0.01, "exposure": 0.02, "pose": [0.2, 0.001]},
        "image": near,
    }
    return [_sphere() | {"capture.toml": _toml(tables)} for tables in (plain, full)]


def _scenes() -> list[Files]:
    image = {"lights": [{"direction": [0.3, 0.2, 0.9], "irradiance": [3.0, 3.0, 3.0]}], "exposure": 0.7, "ambient": 0.02}
    tables = {
        "geometry": {"shape": "sphere", "centre": [8.0, 8.0], "radius": 6.0},
        "camera": {"resolution": [16, 16], "supersampling": 2, "wavelength": [0.61, 0.55, 0.46]},
        "encoding": {"transfer": "srgb", "black": 0.02},
        "noise": {"read": 0.002, "gain": 0.0005, "bits": 16, "seed": 1},
        "material": {"model": "cook-torrance", "diffuse": [0.4, 0.2, 0.1], "specular": 0.8, "slope": 0.2, "f0": 0.04},
        "image": [image, image],
    }
    mesh = {
        **tables,
        "material": {"preset": "foam"},
        "geometry": {"mesh": "a.off"},
        "camera": {"kind": "perspective", "position": [0.0, 0.0, 5.0], "fov_y": 0.5, "resolution": [16, 16]},
    }
    return [{"scene.toml": _toml(each), "a.off": _mesh("off")} for each in (tables, mesh)]


def _toml(tables: dict[str, Any]) -> bytes:
    import tomli_w

    return tomli_w.dumps(tables).encode()


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


def _light_list() -> list[Files]:
    lines = [f"{name} {x} {y} {z}" for name, (x, y, z) in zip(_PHOTOGRAPHS, _LIGHTS, strict=True)]
    return [_sphere() | {"a.lp": "\n".join([str(len(lines)), *lines, ""]).encode()}]


def _domes() -> list[Files]:
    of_names = [dict(zip("xyz", light, strict=True)) for light in _LIGHTS]
    near = {"lightConfiguration": "spherical", "imageWidth": 2.0, "domeDiameter": 6.0, "verticalOffset": 0.0}
    contents: tuple[dict[str, Any], ...] = (
        {"lightConfiguration": "directional", "directions": of_names, "ledAdjust": [{"r": 1.0, "g": 1.0, "b": 1.0}] * 3},
        {**near, "directions": of_names},
        {"lightConfiguration": "lights3d", "imageWidth": 2.0, "positions3d": [[*light] for light in _LIGHTS]},
    )
    return [_sphere() | {"a.dome": json.dumps(content).encode()} for content in contents]


def _diligent() -> list[Files]:
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in _LIGHTS).encode()
    listed = "".join(f"{name}\n" for name in _PHOTOGRAPHS).encode()
    strengths = b"1.1 1.1 1.1\n0.9 0.9 0.9\n1 1 1\n"
    return [_sphere() | {"light_directions.txt": rows, "light_intensities.txt": strengths, "filenames.txt": listed}]


def _transforms() -> list[Files]:
    matrix = [[1.0, 0, 0, 0.5], [0, 1, 0, 0.2], [0, 0, 1, 4], [0, 0, 0, 1]]
    frames = [{"file_path": name, "transform_matrix": matrix} for name in _PHOTOGRAPHS]
    lens = {"fl_x": 70.0, "fl_y": 70.0, "cx": 30.0, "cy": 20.0, "w": 60, "h": 40, "k1": -0.1, "p1": 0.001}
    nerf = {"camera_model": "OPENCV", **lens, "applied_transform": matrix[:3], "applied_scale": 2.0, "frames": frames}
    blender = {"camera_angle_x": 0.7, "frames": frames}
    return _with_camera("transforms.json", *({"transforms.json": json.dumps(each).encode()} for each in (nerf, blender)))


def _colmap_text() -> list[Files]:
    cameras = b"# Cameras\n7 PINHOLE 60 40 70 70 30 20\n8 OPENCV 60 40 70 70 30 20 -0.1 0.01 0.001 0\n"
    lines = [f"{n} 0.99 0.1 0.05 0.02 0.1 0.2 3 {7 + n % 2} {name}\n1.5 2.5 -1" for n, name in enumerate(_PHOTOGRAPHS)]
    return _with_camera(".", {"cameras.txt": cameras, "images.txt": "\n".join(["# Images", *lines, ""]).encode()})


def _colmap_binary() -> list[Files]:
    camera = struct.pack("<QIiQQ4d", 1, 7, 1, 60, 40, 70, 70, 30, 20)
    images = struct.pack("<Q", len(_PHOTOGRAPHS))
    for number, name in enumerate(_PHOTOGRAPHS):
        images += struct.pack("<I7dI", number, 0.99, 0.1, 0.05, 0.02, 0.1, 0.2, 3, 7) + name.encode() + b"\0"
        images += struct.pack("<QddQ", 1, 1.5, 2.5, 17)
    return _with_camera(".", {"cameras.bin": camera, "images.bin": images})


def _with_camera(file: str, *contents: Files) -> list[Files]:
    """Captures whose camera is that of a photograph in a file or folder."""
    tables = {
        "geometry": {"mesh": "a.off"},
        "camera": {"file": file, "frame": _PHOTOGRAPHS[1]},
        "image": [{"file": "view.png"}],
    }
    return [{"capture.toml": _toml(tables), **content} for content in contents]


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


def _circles() -> list[Files]:
    return [_sphere() | {"circle_data.txt": b"8\n8\n6.5\n"}]


def _mirror(folder: Path) -> Iterable[Any]:
    from matest.capture.mirrors import load_mirror

    return [sphere.circle for sphere in load_mirror(folder).spheres]


def _mesh(kind: str, **options: Any) -> bytes:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=1)
    content = mesh.export(file_type=kind, **options)
    return content.encode() if isinstance(content, str) else content


def _meshes(kind: str, *options: dict[str, Any]) -> list[Files]:
    return [{f"a.{kind}": _mesh(kind, **each)} for each in options or ({},)]


def _stls() -> list[Files]:
    return [{"a.stl": _mesh(kind)} for kind in ("stl", "stl_ascii")]


def _objects() -> list[Files]:
    textured = b"mtllib a.mtl\no box\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl m\n"
    faces = b"f 1/1/1 2/2/1 3/3/1\nf 1//1 3//1 4//1\nf -4 -2 -1\n"
    return [{"a.obj": content, "a.mtl": b"newmtl m\nKd 1 1 1\n"} for content in (_mesh("obj"), textured + faces)]


def _gltf() -> list[Files]:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=0)
    scene = trimesh.Scene([mesh, mesh.copy().apply_translation([1, 2, 3])])
    return [{"a.glb": _mesh("glb")}, {"a.glb": scene.export(file_type="glb")}]


def _surface(file: str, folder: Path) -> Iterable[Any]:
    from matest.errors import errors_of
    from matest.scene.camera import Camera
    from matest.scene.mesh import Mesh
    from matest.scene.surface import from_mesh

    path = folder / file
    mesh = Mesh.load(path)
    with errors_of(path):
        surface = from_mesh(mesh, Camera(height=3.0), (_SIDE, _SIDE), None, np.float32)
    yield from (mesh.vertices, surface.normals, surface.positions, mesh.extent, mesh.convex)


def _csv_tables() -> list[Files]:
    rows = [f"{i},{p},{r},0,{0.3},{0.2}" for i in (0, 20, 40, 60) for p in (0, 90, 180) for r in (10, 30, 50)]
    head, units = "theta_i,phi_i,theta_r,phi_r,{},{}", ["# units: deg", "# quantity: f"]
    return [
        {"a.csv": "\n".join([*units, f"# azimuth: {azimuth}", head.format(*names), *rows]).encode()}
        for azimuth, names in (("forward", ("450 nm", "550 nm")), ("retro", ("R", "G")))
    ]


def _cornell() -> list[Files]:
    rows = [f"{i} 0 {r} {p} 0.1 0.2 0.3" for i in (0.1, 0.6) for r in (0.2, 0.9) for p in (0, 1.5, 3.1)]
    return [{"a.brdf": "\n".join(["3 # wavelengths", "450 550 650", *rows]).encode()}]


def _merl() -> list[Files]:
    from matest.tables.merl import CELLS, SHAPE

    return [{"a.binary": np.array(SHAPE, "<i4").tobytes() + np.full(3 * CELLS, 300.0, "<f8").tobytes()}]


def _table(file: str, folder: Path) -> Iterable[Any]:
    from matest.tables import load_table

    table = load_table(folder / file)
    return table.wi, table.wo, table.values


def _constants() -> list[Files]:
    rows = b"".join(b"%.3f, %.3f, %.3f\n" % (0.3 + 0.05 * n, 0.2 + 0.1 * n, 3.5 - 0.1 * n) for n in range(12))
    return [{"a.txt": b"# copper\n" + rows}, {"a.txt": b"wl,n\n0.3,0.2\n0.8,0.3\nwl,k\n0.3,3.1\n0.8,4.2\n"}]


def _optics(folder: Path) -> Iterable[Any]:
    import torch

    from matest.errors import errors_of
    from matest.spectra import optical_constants

    with errors_of(folder / "a.txt"):
        return optical_constants(folder / "a.txt").at(torch.tensor([0.45, 0.55]))


def _materials() -> list[Files]:
    one = {"model": "oren-nayar", "radiometry": "absolute", "parameters": {"albedo": [0.7, 0.6, 0.5], "sigma": 0.5}}
    two = {"model": "lambert+cook-torrance(distribution=ggx)", "parameters": {
        "lambert.albedo": 0.3, "cook-torrance.diffuse": 0.0, "cook-torrance.specular": 0.5,
        "cook-torrance.slope": 0.2, "cook-torrance.f0": 0.04,
    }}  # fmt: skip
    return [{"material.json": json.dumps(content | {"not_determined": []}).encode()} for content in (one, two)]


def _material(folder: Path) -> Iterable[Any]:
    import torch

    from matest.estimation.result import load_material

    material = load_material(folder)
    directions = torch.nn.functional.normalize(torch.tensor([[0.1, 0.2, 0.9], [0.7, 0.1, 0.3]]).double(), dim=-1)
    return [material(directions, directions.flip(0)).detach()]


def _results() -> list[Files]:
    parameters = {
        "albedo": {"value": [0.7, 0.6], "std": [0.1, 0.1], "unit": "1", "status": "determined"},
        "sigma": {"value": None, "std": None, "status": "not determined"},
    }
    content = {
        "schema": "matest.estimate/1",
        "parameters": parameters,
        "provenance": {"capture": "..", "root": "../..", "inputs": {}},
        "maps": {"albedo": {}},
    }
    return [{"result.json": json.dumps(content).encode()}]


def _result(folder: Path) -> Iterable[Any]:
    from matest.estimation.result import read_result
    from matest.report.folder import check_destination

    content = read_result(folder)
    check_destination(folder, "result.json")
    return [parameter["std"] for parameter in content["parameters"].values() if parameter.get("std") is not None]


def _predictions() -> list[Files]:
    images = [{"image": name, "prediction": f"{n:02d}.exr", "relative_rmse": 0.1} for n, name in enumerate(_PHOTOGRAPHS)]
    content = {"schema": "matest.prediction/1", "images": images, "relative_rmse": 0.1, "maps": ["albedo"]}
    return [{"prediction.json": json.dumps(content).encode(), "00.exr": b"", "profile.csv": b""}]


def _prediction(folder: Path) -> Iterable[Any]:
    from matest.report.folder import check_destination

    check_destination(folder, "prediction.json")
    return ()


def _maps() -> list[Files]:
    from matest.photographs.images import write_image

    files: dict[str, bytes] = {}
    surface = _map_surface()
    with TemporaryDirectory() as place:
        for name, image in {
            "albedo.exr": surface.image(np.full((len(surface), 1), 0.5, np.float32)),
            "albedo_std.exr": surface.image(np.full((len(surface), 1), 0.01, np.float32)),
            "albedo_status.png": surface.image(np.ones(len(surface), np.uint8)),
            "normals.png": surface.image((127.5 * (surface.normals.numpy() + 1)).round().astype(np.uint8)),
        }.items():
            path = Path(place) / name
            write_image(path, image)
            files[f"maps/{name}"] = path.read_bytes()
    return [files]


@lru_cache(maxsize=1)
def _map_surface() -> Any:
    from matest.scene.surface import from_sphere

    return from_sphere((_SIDE, _SIDE), (_SIDE / 2, _SIDE / 2), _RADIUS, None)


def _map(folder: Path) -> Iterable[Any]:
    from matest.report.maps import load_maps

    for each in load_maps(folder, _map_surface()).values():
        yield each.status


def _checkpoints() -> list[Files]:
    import torch

    from matest.training.checkpoint import write_checkpoint

    with TemporaryDirectory() as place:
        path = Path(place) / "a.safetensors"
        write_checkpoint(path, {"step": 3, "rates": [0.1, 0.2], "state": {"a": torch.ones(2, 3), 0: (1, None)}})
        return [{"a.safetensors": path.read_bytes()}]


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
    Reader("capture.toml", "capture.toml", _captures, _capture, (*OF_TEXT, *3 * (revalued_toml,)), cost=10),
    Reader("scene.toml", "scene.toml", _scenes, _scene, (*OF_TEXT, *3 * (revalued_toml,)), cost=10),
    Reader(".lp", "a.lp", _light_list, _capture, OF_TEXT, cost=10),
    Reader(".dome", "a.dome", _domes, _capture, _JSON, cost=10),
    Reader("DiLiGenT directions", "light_directions.txt", _diligent, _capture, OF_TEXT, cost=10),
    Reader("DiLiGenT intensities", "light_intensities.txt", _diligent, _capture, OF_TEXT, cost=10),
    Reader("DiLiGenT names", "filenames.txt", _diligent, _capture, OF_TEXT, cost=10),
    Reader("circle_data.txt", "circle_data.txt", _circles, _mirror, OF_TEXT, cost=5),
    Reader("transforms.json", "transforms.json", _transforms, _camera, _JSON, cost=5),
    Reader("COLMAP cameras.txt", "cameras.txt", _colmap_text, _camera, OF_TEXT, cost=5),
    Reader("COLMAP images.txt", "images.txt", _colmap_text, _camera, OF_TEXT, cost=5),
    Reader("COLMAP cameras.bin", "cameras.bin", _colmap_binary, _camera, cost=5),
    Reader("COLMAP images.bin", "images.bin", _colmap_binary, _camera, cost=5),
    Reader("PLY", "a.ply", partial(_meshes, "ply", {}, {"encoding": "ascii"}), partial(_surface, "a.ply"), cost=5),
    Reader("OBJ", "a.obj", _objects, partial(_surface, "a.obj"), OF_TEXT, cost=5),
    Reader("STL", "a.stl", _stls, partial(_surface, "a.stl"), cost=5),
    Reader("GLB", "a.glb", _gltf, partial(_surface, "a.glb"), (*OF_BYTES, *4 * (revalued_glb,)), cost=5),
    Reader("OFF", "a.off", partial(_meshes, "off"), partial(_surface, "a.off"), OF_TEXT, cost=5),
    Reader("CSV table", "a.csv", _csv_tables, partial(_table, "a.csv"), OF_TEXT, cost=2),
    Reader("Cornell .brdf", "a.brdf", _cornell, partial(_table, "a.brdf"), OF_TEXT),
    Reader("MERL .binary", "a.binary", _merl, partial(_table, "a.binary"), cost=1000, megabytes=256),
    Reader("optical constants", "a.txt", _constants, _optics, OF_TEXT),
    Reader("material.json", "material.json", _materials, _material, _JSON, cost=2),
    Reader("result.json", "result.json", _results, _result, _JSON),
    Reader("prediction.json", "prediction.json", _predictions, _prediction, _JSON),
    Reader("maps: values", "maps/albedo.exr", _maps, _map),
    Reader("maps: normals", "maps/normals.png", _maps, _map),
    Reader("checkpoint", "a.safetensors", _checkpoints, _checkpoint, (*OF_BYTES, OF_TEXT[0])),
)
