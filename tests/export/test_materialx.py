"""The MaterialX writer: the document is valid, and evaluated by MaterialX's own GLSL, read as Python."""

from __future__ import annotations

import math
import re
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from matest.brdf import Brdf, CookTorrance, Eon, Lambert, OrenNayar, OrenNayarQualitative
from matest.errors import InputError
from matest.export import materialx
from matest.export.conversion import Conversion
from tests.export.materials import BRUSHED, FOAM, GLOSS, METAL, PAPER, even_pairs

mx: Any = pytest.importorskip("MaterialX")
MATERIALS = {
    "gloss": GLOSS,
    "foam": FOAM,
    "metal": METAL,
    "paper": PAPER,
    "brushed": BRUSHED,
    "clay": OrenNayar([0.7, 0.5, 0.3], 0.5),
}
_LIBRARY = Path(mx.__file__).parent / "libraries" / "pbrlib" / "genglsl" / "lib"
_FUNCTIONS = (
    "mx_oren_nayar_diffuse",
    "mx_oren_nayar_fujii_diffuse_dir_albedo",
    "mx_oren_nayar_fujii_diffuse_avg_albedo",
    "mx_oren_nayar_compensated_diffuse",
    "mx_ggx_NDF",
    "mx_ggx_smith_G2",
    "mx_ggx_dir_albedo_analytic",
)
Written = dict[str, tuple[Path, Conversion]]
# MaterialX fits the albedo of a white lobe by a rational function, which is off by so much.
COMPENSATION = 0.03


class Vector(np.ndarray):
    """A vector of GLSL: letters choose its elements."""

    def __getattr__(self, letters: str) -> Any:
        places = ["xyzw".index(letter) for letter in letters]
        return self[places[0]] if len(places) == 1 else self[places]


def vector(count: int) -> Callable[..., Any]:
    def made(*values: float) -> Any:
        return np.array(values * count if len(values) == 1 else values, dtype=float).view(Vector)

    return made


def as_python(source: str, name: str) -> str:
    """The function of that name, its arithmetic taken as it is: GLSL's expressions are Python's."""
    match = re.search(rf"^\w+ {name}\((.*?)\)\n{{\n(.*?)^}}", source, re.M | re.S)
    assert match, name
    arguments = ", ".join(part.split()[-1] for part in match[1].split(","))
    statements = [" ".join(part.split()) for part in re.sub(r"//.*", "", match[2]).split(";")]
    lines = []
    for statement in filter(None, statements):
        line = re.sub(r"^(?:float|vec\d) (?=\w+ =)", "", statement)
        lines.append("    " + re.sub(r"= (.*) \? (.*) : (.*)", r"= (\2) if (\1) else (\3)", line))
    return "\n".join([f"def {name}({arguments}):", *lines])


@pytest.fixture(scope="module")
def glsl() -> types.SimpleNamespace:
    """MaterialX's functions of diffuse and specular reflection."""
    source = "\n".join((_LIBRARY / f"mx_microfacet_{part}.glsl").read_text() for part in ("diffuse", "specular"))
    scope: dict[str, Any] = {
        "mx_square": np.square, "mx_acos": np.arccos, "sqrt": np.sqrt, "max": np.maximum, "dot": np.dot,
        "clamp": np.clip, "vec2": vector(2), "vec3": vector(3), "vec4": vector(4),
        "M_PI": math.pi, "M_PI_INV": 1 / math.pi, "M_FLOAT_EPS": 1e-6,
        "FUJII_CONSTANT_1": 0.5 - 2.0 / (3.0 * math.pi), "FUJII_CONSTANT_2": 2.0 / 3.0 - 28.0 / (15.0 * math.pi),
    }  # fmt: skip
    for name in _FUNCTIONS:
        exec(as_python(source, name), scope)
    return types.SimpleNamespace(**{name.removeprefix("mx_"): scope[name] for name in _FUNCTIONS})


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """The document of every material, and what the writer says."""
    folder = tmp_path_factory.mktemp("materialx")
    paths = {name: folder / f"my {name}.mtlx" for name in MATERIALS}
    return {name: (path, materialx.write(MATERIALS[name], path)) for name, path in paths.items()}


def document(path: Path) -> Any:
    """The document with MaterialX's own libraries."""
    content, library = mx.createDocument(), mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    mx.readFromXmlFile(content, str(path))
    content.setDataLibrary(library)
    return content


def evaluated(content: Any, glsl: types.SimpleNamespace, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """f [n, 3] of the nodes that the document holds: body and surface, added up."""
    values = {
        node.getName(): {entry.getName(): entry.getValue() for entry in node.getInputs()} for node in content.getNodes()
    }
    kinds = {node.getName(): node.getCategory() for node in content.getNodes()}
    out = []
    for light, viewer in zip(wi, wo, strict=True):
        n_l, n_v, l_v = light[2], viewer[2], light @ viewer
        half = ((light + viewer) / np.linalg.norm(light + viewer)).view(Vector)
        body = values["body"]
        colour, rough = np.array(list(body["color"])), body["roughness"]
        if body["energy_compensation"]:
            f = glsl.oren_nayar_compensated_diffuse(n_v, n_l, l_v, rough, colour) / math.pi
        else:
            f = glsl.oren_nayar_diffuse(n_v, n_l, l_v, rough) * colour / math.pi
        if "surface" in values:
            surface = values["surface"]
            alpha = np.array(list(surface["roughness"])).view(Vector)
            v_h = float(half @ viewer)
            if kinds["surface"] == "dielectric_bsdf":
                n = surface["ior"]
                # Fresnel's own equations.
                t = math.sqrt(1 - (1 - v_h**2) / n**2)
                fresnel = 0.5 * (((v_h - n * t) / (v_h + n * t)) ** 2 + ((t - n * v_h) / (t + n * v_h)) ** 2)
                fresnel = np.full(3, fresnel)
            else:
                f0 = np.array(list(surface["color0"]))
                fresnel = f0 + (1 - f0) * (1 - v_h) ** 5
            mean = math.sqrt(alpha.x * alpha.y)
            white = glsl.ggx_dir_albedo_analytic(n_v, mean, 1.0, 1.0)
            white = float(np.ravel(white)[0])
            lobe = glsl.ggx_NDF(half, alpha) * glsl.ggx_smith_G2(n_l, n_v, mean) / (4 * n_l * n_v)
            tint = np.array(list(surface["tint"])) if "tint" in surface else 1.0
            f = f + fresnel * lobe * tint * (1 + fresnel * (1 - white) / white)
        out.append(f)
    return np.array(out)


@pytest.mark.parametrize("name", MATERIALS)
def test_documents_are_valid_and_renderers_get_a_shader(name: str, written: Written) -> None:
    import MaterialX.PyMaterialXGenGlsl as gen_glsl
    import MaterialX.PyMaterialXGenShader as gen_shader

    content = document(written[name][0])
    assert content.validate() == (True, "")
    (material,) = content.getMaterialNodes()
    assert material.getName() == f"my_{name}_material"
    generator = gen_glsl.GlslShaderGenerator.create()
    context = gen_shader.GenContext(generator)
    context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
    shader = mx.getConnectedOutputs(material)[0] if mx.getConnectedOutputs(material) else content.getNode("shader")
    source = generator.generate("ball", shader, context).getSourceCode(gen_shader.PIXEL_STAGE)
    assert "mx_oren_nayar_diffuse_bsdf(" in source


@pytest.mark.parametrize("name", MATERIALS)
def test_the_stated_error_is_that_of_its_own_shader(name: str, glsl: types.SimpleNamespace, written: Written) -> None:
    path, conversion = written[name]
    wi, wo = even_pairs(6_000)
    truth = MATERIALS[name](wi, wo).expand(-1, 3)
    values = torch.from_numpy(evaluated(document(path), glsl, wi.numpy(), wo.numpy()))
    difference = (values - truth) * wi[:, 2:]
    relative = math.sqrt(float(difference.square().sum() / (truth * wi[:, 2:]).square().sum()))
    assert relative == pytest.approx(conversion.error.relative_rmse, rel=0.2)


@pytest.mark.parametrize(
    "material",
    [Lambert([0.5, 0.4, 0.3]), OrenNayarQualitative([0.9, 0.5, 0.3], 0.6), Eon([0.9, 0.5, 0.3], 0.6)],
    ids=lambda material: material.expression,
)
def test_bodies_that_materialx_has_are_converted_exactly(
    material: Brdf, glsl: types.SimpleNamespace, tmp_path: Path
) -> None:
    conversion = materialx.write(material, tmp_path / "ball.mtlx")
    assert conversion.error.relative_rmse < 1e-12
    wi, wo = even_pairs(500)
    values = evaluated(document(tmp_path / "ball.mtlx"), glsl, wi.numpy(), wo.numpy())
    torch.testing.assert_close(torch.from_numpy(values), material(wi, wo).expand(-1, 3), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("alpha", [0.1, 0.3, 0.6])
def test_white_lobes_get_back_what_the_shader_gives_them(alpha: float, glsl: types.SimpleNamespace) -> None:
    ours = materialx._white_albedo(torch.tensor(alpha, dtype=torch.float64))[8::4, 0]
    cosines = np.linspace(0, 1, 33)[8::4]
    theirs = [float(np.ravel(glsl.ggx_dir_albedo_analytic(cos, alpha, 1.0, 1.0))[0]) for cos in cosines]
    assert ours.tolist() == pytest.approx(theirs, abs=COMPENSATION)


def test_the_surface_has_the_width_of_ggx(tmp_path: Path) -> None:
    material = CookTorrance([0.4, 0.3, 0.2], 1.0, 0.15, distribution="ggx", masking="smith")
    conversion = materialx.write(material, tmp_path / "ball.mtlx")
    # What the heights' correlation and the second bounce change is small on a dielectric of this slope.
    assert conversion.parameters["surface_roughness"] == pytest.approx(0.15, rel=0.02)
    assert conversion.error.relative_rmse < 0.02


def test_the_error_is_in_the_document(written: Written) -> None:
    path, conversion = written["gloss"]
    doc = document(path).getMaterialNodes()[0].getAttribute("doc")
    assert doc.startswith(f"cook-torrance by matest; error of the conversion {conversion.error}.")


def test_other_channels_than_rgb_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"MaterialX's color3 has the channels R, G, B, and the material has 2"):
        materialx.write(Lambert([0.1, 0.2]), tmp_path / "ball.mtlx")
