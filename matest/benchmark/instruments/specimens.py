"""Small files of every other kind that matest reads, in the folders that they belong to."""

from __future__ import annotations

import io
import json
import struct
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from matest.benchmark.instruments.endurance import Files

# Side of the photographs, in which a sphere has this radius; all lights shine with π.
SIDE, _RADIUS = 16, 6.5
_LIGHTS = ((0.3, 0.2, 0.9), (-0.5, 0.1, 0.8), (0.1, -0.4, 0.9))
_ALBEDO = 0.5
_MASK = "mask.png"
_PHOTOGRAPHS = tuple(f"{number}.npy" for number in range(len(_LIGHTS)))


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
    rows, columns = (np.indices((SIDE, SIDE)) + 0.5 - SIDE / 2) / _RADIUS
    # Pixels on the edge are covered in part.
    coverage = np.clip(_RADIUS * (1 - np.hypot(rows, columns)) + 0.5, 0, 1)
    inside = rows**2 + columns**2 < 1
    normals = np.dstack([columns, -rows, np.sqrt(np.clip(1 - rows**2 - columns**2, 0, None))]) * inside[..., None]
    files = {_MASK: _encoded(".png", (255 * coverage).astype(np.uint8)), "normals.npy": _saved(normals)}
    for name, light in zip(_PHOTOGRAPHS, _LIGHTS, strict=True):
        shade = np.clip(normals @ np.array(light) / np.linalg.norm(light), 0, None)
        files[name] = _saved((_ALBEDO * shade).astype(np.float32))
    return files


def captures() -> list[Files]:
    images = [
        {"file": name, "lights": [{"direction": [*light]}]} for name, light in zip(_PHOTOGRAPHS, _LIGHTS, strict=True)
    ]
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


def scenes() -> list[Files]:
    image = {
        "lights": [{"direction": [0.3, 0.2, 0.9], "irradiance": [3.0, 3.0, 3.0]}],
        "exposure": 0.7,
        "ambient": 0.02,
    }
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


def light_list() -> list[Files]:
    lines = [f"{name} {x} {y} {z}" for name, (x, y, z) in zip(_PHOTOGRAPHS, _LIGHTS, strict=True)]
    return [_sphere() | {"a.lp": "\n".join([str(len(lines)), *lines, ""]).encode()}]


def domes() -> list[Files]:
    of_names = [dict(zip("xyz", light, strict=True)) for light in _LIGHTS]
    near = {"lightConfiguration": "spherical", "imageWidth": 2.0, "domeDiameter": 6.0, "verticalOffset": 0.0}
    contents: tuple[dict[str, Any], ...] = (
        {
            "lightConfiguration": "directional",
            "directions": of_names,
            "ledAdjust": [{"r": 1.0, "g": 1.0, "b": 1.0}] * 3,
        },
        {**near, "directions": of_names},
        {"lightConfiguration": "lights3d", "imageWidth": 2.0, "positions3d": [[*light] for light in _LIGHTS]},
    )
    return [_sphere() | {"a.dome": json.dumps(content).encode()} for content in contents]


def diligent() -> list[Files]:
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in _LIGHTS).encode()
    listed = "".join(f"{name}\n" for name in _PHOTOGRAPHS).encode()
    strengths = b"1.1 1.1 1.1\n0.9 0.9 0.9\n1 1 1\n"
    return [_sphere() | {"light_directions.txt": rows, "light_intensities.txt": strengths, "filenames.txt": listed}]


def transforms() -> list[Files]:
    matrix = [[1.0, 0, 0, 0.5], [0, 1, 0, 0.2], [0, 0, 1, 4], [0, 0, 0, 1]]
    frames = [{"file_path": name, "transform_matrix": matrix} for name in _PHOTOGRAPHS]
    lens = {"fl_x": 70.0, "fl_y": 70.0, "cx": 30.0, "cy": 20.0, "w": 60, "h": 40, "k1": -0.1, "p1": 0.001}
    nerf = {"camera_model": "OPENCV", **lens, "applied_transform": matrix[:3], "applied_scale": 2.0, "frames": frames}
    blender = {"camera_angle_x": 0.7, "frames": frames}
    return _with_camera(
        "transforms.json", *({"transforms.json": json.dumps(each).encode()} for each in (nerf, blender))
    )


def colmap_text() -> list[Files]:
    cameras = b"# Cameras\n7 PINHOLE 60 40 70 70 30 20\n8 OPENCV 60 40 70 70 30 20 -0.1 0.01 0.001 0\n"
    lines = [f"{n} 0.99 0.1 0.05 0.02 0.1 0.2 3 {7 + n % 2} {name}\n1.5 2.5 -1" for n, name in enumerate(_PHOTOGRAPHS)]
    return _with_camera(".", {"cameras.txt": cameras, "images.txt": "\n".join(["# Images", *lines, ""]).encode()})


def colmap_binary() -> list[Files]:
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


def circles() -> list[Files]:
    return [_sphere() | {"circle_data.txt": b"8\n8\n6.5\n"}]


def _mesh(kind: str, **options: Any) -> bytes:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=1)
    content = mesh.export(file_type=kind, **options)
    return content.encode() if isinstance(content, str) else content


def meshes(kind: str, *options: dict[str, Any]) -> list[Files]:
    return [{f"a.{kind}": _mesh(kind, **each)} for each in options or ({},)]


def stls() -> list[Files]:
    return [{"a.stl": _mesh(kind)} for kind in ("stl", "stl_ascii")]


def objects() -> list[Files]:
    textured = b"mtllib a.mtl\no box\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl m\n"
    faces = b"f 1/1/1 2/2/1 3/3/1\nf 1//1 3//1 4//1\nf -4 -2 -1\n"
    return [{"a.obj": content, "a.mtl": b"newmtl m\nKd 1 1 1\n"} for content in (_mesh("obj"), textured + faces)]


def gltf() -> list[Files]:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=0)
    scene = trimesh.Scene([mesh, mesh.copy().apply_translation([1, 2, 3])])
    return [{"a.glb": _mesh("glb")}, {"a.glb": scene.export(file_type="glb")}]


def csv_tables() -> list[Files]:
    rows = [f"{i},{p},{r},0,{0.3},{0.2}" for i in (0, 20, 40, 60) for p in (0, 90, 180) for r in (10, 30, 50)]
    head, units = "theta_i,phi_i,theta_r,phi_r,{},{}", ["# units: deg", "# quantity: f"]
    return [
        {"a.csv": "\n".join([*units, f"# azimuth: {azimuth}", head.format(*names), *rows]).encode()}
        for azimuth, names in (("forward", ("450 nm", "550 nm")), ("retro", ("R", "G")))
    ]


def cornell() -> list[Files]:
    rows = [f"{i} 0 {r} {p} 0.1 0.2 0.3" for i in (0.1, 0.6) for r in (0.2, 0.9) for p in (0, 1.5, 3.1)]
    return [{"a.brdf": "\n".join(["3 # wavelengths", "450 550 650", *rows]).encode()}]


def merl() -> list[Files]:
    from matest.tables.merl import CELLS, SHAPE

    return [{"a.binary": np.array(SHAPE, "<i4").tobytes() + np.full(3 * CELLS, 300.0, "<f8").tobytes()}]


def constants() -> list[Files]:
    rows = b"".join(b"%.3f, %.3f, %.3f\n" % (0.3 + 0.05 * n, 0.2 + 0.1 * n, 3.5 - 0.1 * n) for n in range(12))
    return [{"a.txt": b"# copper\n" + rows}, {"a.txt": b"wl,n\n0.3,0.2\n0.8,0.3\nwl,k\n0.3,3.1\n0.8,4.2\n"}]


def materials() -> list[Files]:
    one = {"model": "oren-nayar", "radiometry": "absolute", "parameters": {"albedo": [0.7, 0.6, 0.5], "sigma": 0.5}}
    two = {"model": "lambert+cook-torrance(distribution=ggx)", "parameters": {
        "lambert.albedo": 0.3, "cook-torrance.diffuse": 0.0, "cook-torrance.specular": 0.5,
        "cook-torrance.slope": 0.2, "cook-torrance.f0": 0.04,
    }}  # fmt: skip
    return [{"material.json": json.dumps(content | {"not_determined": []}).encode()} for content in (one, two)]


def results() -> list[Files]:
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


def predictions() -> list[Files]:
    images = [
        {"image": name, "prediction": f"{n:02d}.exr", "relative_rmse": 0.1} for n, name in enumerate(_PHOTOGRAPHS)
    ]
    content = {"schema": "matest.prediction/1", "images": images, "relative_rmse": 0.1, "maps": ["albedo"]}
    return [{"prediction.json": json.dumps(content).encode(), "00.exr": b"", "profile.csv": b""}]


def maps() -> list[Files]:
    from matest.photographs.images import write_image

    files: dict[str, bytes] = {}
    surface = map_surface()
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
def map_surface() -> Any:
    from matest.scene.surface import from_sphere

    return from_sphere((SIDE, SIDE), (SIDE / 2, SIDE / 2), _RADIUS, None)


def checkpoints() -> list[Files]:
    import torch

    from matest.training.checkpoint import write_checkpoint

    with TemporaryDirectory() as place:
        path = Path(place) / "a.safetensors"
        write_checkpoint(path, {"step": 3, "rates": [0.1, 0.2], "state": {"a": torch.ones(2, 3), 0: (1, None)}})
        return [{"a.safetensors": path.read_bytes()}]
