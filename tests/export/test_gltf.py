"""The glTF writer: read back with nothing of it, evaluated by the specification's appendix B, and validated."""

from __future__ import annotations

import base64
import json
import math
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from matest.brdf import Brdf, CookTorrance, Lambert, OrenNayar, Ward
from matest.errors import InputError
from matest.export import gltf
from matest.export.conversion import Conversion
from tests.export.materials import BRUSHED, FOAM, GLOSS, METAL, PAPER, even_pairs

pytest.importorskip("pygltflib")
MATERIALS = {
    "gloss": GLOSS,
    "foam": FOAM,
    "metal": METAL,
    "paper": PAPER,
    "clay": OrenNayar([0.7, 0.5, 0.3], 0.5),
}
Written = dict[str, tuple[Path, Conversion]]
_VALIDATE = """
const validator = require("gltf-validator"), fs = require("fs");
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1]))).then((r) => console.log(JSON.stringify(r)));
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """The file of every material, and what the writer says."""
    folder = tmp_path_factory.mktemp("gltf")
    paths = {name: folder / f"{name}.glb" for name in MATERIALS}
    return {name: (path, gltf.write(MATERIALS[name], path)) for name, path in paths.items()}


def chunks(path: Path) -> tuple[dict[str, Any], bytes]:
    """JSON and binary of a `.glb` file."""
    data = path.read_bytes()
    magic, version, length = struct.unpack("<4sII", data[:12])
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + size]), data[20 + size + 8 :]


def evaluated(material: dict[str, Any], wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """f [n, 3] by appendix B of the specification and of KHR_materials_specular and KHR_materials_ior."""
    pbr, extensions = material["pbrMetallicRoughness"], material.get("extensions", {})
    base = np.array(pbr["baseColorFactor"][:3])
    alpha2 = pbr["roughnessFactor"] ** 4
    half = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    n_l, n_v, n_h, v_h = wi[:, 2:], wo[:, 2:], half[:, 2:], (wo * half).sum(1, keepdims=True)
    if "KHR_materials_anisotropy" in extensions:
        d, v = of_two_widths(math.sqrt(alpha2), extensions["KHR_materials_anisotropy"], wi, wo, half)
    else:
        d, v = of_one_width(alpha2, n_l, n_v, n_h)
    rise = (1 - v_h) ** 5
    metal = d * v * (base + (1 - base) * rise)
    ior = extensions.get("KHR_materials_ior", {}).get("ior", 1.5)
    specular = extensions.get("KHR_materials_specular", {})
    f0 = np.minimum(((1 - ior) / (1 + ior)) ** 2 * np.array(specular.get("specularColorFactor", [1, 1, 1])), 1)
    fresnel, weight = f0 + (1 - f0) * rise, specular.get("specularFactor", 1)
    coat = (1 - weight * fresnel.max(1, keepdims=True)) * base / math.pi + weight * fresnel * d * v
    return pbr["metallicFactor"] * metal + (1 - pbr["metallicFactor"]) * coat


def of_one_width(alpha2: float, n_l: np.ndarray, n_v: np.ndarray, n_h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """D and V of appendix B [n, 1]."""
    d = alpha2 / (math.pi * (n_h**2 * (alpha2 - 1) + 1) ** 2)
    v = 1.0
    for cos in (n_l, n_v):
        v = v / (cos + np.sqrt(alpha2 + (1 - alpha2) * cos**2))
    return d, v


def of_two_widths(
    alpha: float, extension: dict[str, float], wi: np.ndarray, wo: np.ndarray, half: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """D and V of KHR_materials_anisotropy [n, 1], in the frame that it turns."""
    across, along = alpha, alpha + (1 - alpha) * extension["anisotropyStrength"] ** 2
    cos, sin = math.cos(extension["anisotropyRotation"]), math.sin(extension["anisotropyRotation"])
    frame = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    light, viewer, facet = (vectors @ frame.T for vectors in (wi, wo, half))
    stretched = facet / (along, across, 1)
    d = 1 / (math.pi * along * across * (stretched**2).sum(1, keepdims=True) ** 2)
    lengths = [np.linalg.norm(vectors * (along, across, 1), axis=1, keepdims=True) for vectors in (light, viewer)]
    # The specification's own function is at most 1.
    return d, np.clip(0.5 / (lengths[1] * light[:, 2:] + lengths[0] * viewer[:, 2:]), 0, 1)


@pytest.mark.parametrize("name", MATERIALS)
def test_the_stated_error_is_that_of_the_specification(name: str, written: Written) -> None:
    path, conversion = written[name]
    material = chunks(path)[0]["materials"][0]
    wi, wo = even_pairs(60_000)
    truth = MATERIALS[name](wi, wo).expand(-1, 3)
    difference = (torch.from_numpy(evaluated(material, wi.numpy(), wo.numpy())) - truth) * wi[:, 2:]
    relative = math.sqrt(float(difference.square().sum() / (truth * wi[:, 2:]).square().sum()))
    assert relative == pytest.approx(conversion.error.relative_rmse, rel=0.1)
    assert material["extras"]["matest"]["relative_rmse"] == conversion.error.relative_rmse
    assert relative < 0.25


def test_the_stated_error_of_two_widths_is_that_of_the_specification(tmp_path: Path) -> None:
    for form in ("bounded", "ward"):
        brushed = Ward([0.2, 0.15, 0.1], 0.1, slope_x=0.3, slope_y=0.1, anisotropy="axes", form=form)
        conversion = gltf.write(brushed, tmp_path / "ball.glb")
        wi, wo = even_pairs(60_000)
        material = chunks(tmp_path / "ball.glb")[0]["materials"][0]
        truth = brushed(wi, wo).expand(-1, 3)
        difference = (torch.from_numpy(evaluated(material, wi.numpy(), wo.numpy())) - truth) * wi[:, 2:]
        relative = math.sqrt(float(difference.square().sum() / (truth * wi[:, 2:]).square().sum()))
        assert relative == pytest.approx(conversion.error.relative_rmse, rel=0.1)


def test_a_ggx_metal_with_schlicks_reflectance_is_converted_exactly(tmp_path: Path) -> None:
    metal = CookTorrance(0.0, 1.0, 0.15, distribution="ggx", masking="smith", fresnel="schlick", f0=[0.9, 0.6, 0.3])
    conversion = gltf.write(metal, tmp_path / "ball.glb")
    assert conversion.error.relative_rmse < 1e-9
    pbr = chunks(tmp_path / "ball.glb")[0]["materials"][0]["pbrMetallicRoughness"]
    assert pbr["roughnessFactor"] == pytest.approx(math.sqrt(0.15))
    assert pbr["baseColorFactor"] == pytest.approx([0.9, 0.6, 0.3, 1])
    assert pbr["metallicFactor"] == 1


def test_a_lambertian_body_has_no_highlight(tmp_path: Path) -> None:
    conversion = gltf.write(Lambert([0.5, 0.4, 0.3]), tmp_path / "ball.glb")
    assert conversion.error.relative_rmse < 1e-9
    assert conversion.parameters["specularFactor"] == 0


def test_rough_bodies_become_lambertian_and_the_error_says_so(written: Written) -> None:
    conversion = written["clay"][1]
    assert conversion.parameters["specularFactor"] == 0
    assert 0.05 < conversion.error.relative_rmse < 0.25


@pytest.mark.parametrize("name", [*MATERIALS, "brushed"])
def test_the_validator_of_khronos_has_nothing_to_say(name: str, written: Written, tmp_path: Path) -> None:
    path = tmp_path / "brushed.glb"
    if name == "brushed":
        gltf.write(BRUSHED, path)
    else:
        path = written[name][0]
    node = shutil.which("node")
    known = node and subprocess.run([node, "-e", 'require("gltf-validator")'], capture_output=True).returncode == 0
    if not node or not known:
        pytest.skip("gltf-validator is not installed: npm install gltf-validator, and NODE_PATH to its folder")
    arguments = [node, "-e", _VALIDATE, str(path)]
    report = json.loads(subprocess.run(arguments, capture_output=True, text=True, check=True).stdout)
    # The validator knows nothing of the extension, which asks for tangents.
    allowed = {"UNUSED_MESH_TANGENT"} if name == "brushed" else set()
    assert {message["code"] for message in report["issues"]["messages"]} <= allowed


def test_the_material_is_on_a_unit_sphere_that_faces_outward(tmp_path: Path) -> None:
    gltf.write(Lambert(0.5), tmp_path / "ball.glb")
    document, blob = chunks(tmp_path / "ball.glb")
    faces, points = (document["bufferViews"][document["accessors"][k]["bufferView"]] for k in (0, 1))
    indices = np.frombuffer(blob, "<u2", document["accessors"][0]["count"], faces["byteOffset"]).reshape(-1, 3)
    vertices = np.frombuffer(blob, "<f4", 3 * document["accessors"][1]["count"], points["byteOffset"]).reshape(-1, 3)
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(1, abs=1e-6)
    a, b, c = (vertices[indices[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(1) > 0).all()


@pytest.mark.parametrize(("slopes", "turn"), [((0.3, 0.1), 0.0), ((0.1, 0.3), 0.5 * math.pi)])
def test_facets_that_are_steeper_one_way_have_a_direction(
    slopes: tuple[float, float], turn: float, tmp_path: Path
) -> None:
    brushed = Ward(0.2, 0.1, slope_x=slopes[0], slope_y=slopes[1], anisotropy="axes")
    gltf.write(brushed, tmp_path / "ball.glb")
    document, blob = chunks(tmp_path / "ball.glb")
    extension = document["materials"][0]["extensions"]["KHR_materials_anisotropy"]
    assert extension["anisotropyRotation"] == pytest.approx(turn)
    least = document["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] ** 2
    # GGX is the narrower the longer its tails are, but the ratio of both ways stays.
    widths = least, least + (1 - least) * extension["anisotropyStrength"] ** 2
    assert widths[1] / widths[0] == pytest.approx(3, rel=0.15)
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    normals, tangents = (vectors(document, blob, attributes[name]) for name in ("NORMAL", "TANGENT"))
    assert np.linalg.norm(tangents[:, :3], axis=1) == pytest.approx(1, abs=1e-6)
    assert np.abs((normals * tangents[:, :3]).sum(1)).max() < 1e-6
    assert (tangents[:, 3] == 1).all()


def vectors(document: dict[str, Any], blob: bytes, number: int) -> np.ndarray:
    """An accessor of floats [n, 3 or 4]."""
    accessor = document["accessors"][number]
    width, start = int(accessor["type"][-1]), document["bufferViews"][accessor["bufferView"]]["byteOffset"]
    return np.frombuffer(blob, "<f4", width * accessor["count"], start).reshape(-1, width)


def test_a_text_file_holds_its_own_data(tmp_path: Path) -> None:
    gltf.write(Lambert(0.5), tmp_path / "ball.gltf")
    document = json.loads((tmp_path / "ball.gltf").read_text("utf-8"))
    uri = document["buffers"][0]["uri"]
    assert len(base64.b64decode(uri.partition(",")[2])) >= document["buffers"][0]["byteLength"]


def test_other_suffixes_and_channels_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ball.obj: expected a name that ends in .glb or .gltf"):
        gltf.write(Lambert(0.5), tmp_path / "ball.obj")
    with pytest.raises(InputError, match=r"glTF's RGB has the channels R, G, B, and the material has 4"):
        gltf.write(Lambert([0.1, 0.2, 0.3, 0.4]), tmp_path / "ball.glb")


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygltflib", None)
    with pytest.raises(InputError, match=r"glTF needs pygltflib, which is not installed: pip install"):
        gltf.write(Lambert(0.5), tmp_path / "ball.glb")


def test_albedos_above_one_are_as_white_as_the_format_allows(tmp_path: Path) -> None:
    bright: Brdf = Lambert(0.5).replace({"albedo": torch.tensor([1.5, 0.5, 0.5], dtype=torch.float64)})
    conversion = gltf.write(bright, tmp_path / "ball.glb")
    assert conversion.parameters["baseColorFactor"] == pytest.approx([1, 0.5, 0.5, 1], abs=1e-4)
    assert conversion.error.relative_rmse > 0.2
