"""Every number of docs/conventions.md, computed again."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest
import torch

from matest.brdf import Brdf, CookTorrance, Eon, LiTorrance, OrenNayar, TorranceSparrow
from matest.brdf.fresnel import dielectric, schlick_weight
from matest.brdf.microfacet import beckmann
from matest.directions import Directions
from matest.export import gltf, materialx, mitsuba
from matest.shading import reflectance
from tests.export.materials import BRUSHED
from tests.tolerances import CONVERSION, CONVERSION_DIGIT

PAGE = (Path(__file__).parents[2] / "docs" / "conventions.md").read_text("utf-8")
M, F0 = 0.15, 0.04
ALBEDO = [0.4, 0.3, 0.2]


def cells(*beginning: str) -> list[str]:
    """The row of the page that begins with these cells, without them."""
    for line in PAGE.splitlines():
        row = [cell.strip() for cell in line.strip("|").split("|")]
        if row[: len(beginning)] == list(beginning):
            return row[len(beginning) :]
    raise AssertionError(f"no row {beginning}")


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?", text)]


def along(*angles: float) -> torch.Tensor:
    """Half vectors at angles in radians from the normal [n, 3]."""
    t = torch.tensor(angles, dtype=torch.float64)
    return torch.stack([t.sin(), torch.zeros_like(t), t.cos()], -1)


def test_slopes_are_what_the_page_says() -> None:
    # The rms slope of facets with Beckmann's distribution, and that along one line, by the integral over facets.
    theta = torch.linspace(0, 1.5, 20_001, dtype=torch.float64)
    d = beckmann(Directions(along(*theta.tolist()), along(*theta.tolist())), torch.tensor(M, dtype=torch.float64))[:, 0]
    share = d * theta.cos() * theta.sin() * 2 * math.pi
    square = float(torch.trapezoid(share * theta.tan().square(), theta) / torch.trapezoid(share, theta))
    assert math.sqrt(square) == pytest.approx(M, rel=1e-5)
    assert numbers(cells("slope along a line", "")[0]) == pytest.approx([math.sqrt(square / 2)], abs=5e-5)
    assert numbers(cells("`slope`", "matest `cook-torrance`, `ward`")[0]) == [M]


def fall(model: Brdf, angle: float) -> float:
    """D at an angle over D at the normal: light and viewer are on the half vector, where nothing is masked."""
    half = along(0.0, angle)
    values = model(half, half)[:, 0] * half[:, 2].square()
    return float(values[1] / values[0])


def test_the_same_lobe_has_these_numbers_in_our_models() -> None:
    sigma = M / math.sqrt(2)
    assert numbers(cells("`sigma`", "matest `torrance-sparrow`")[0]) == pytest.approx(
        [sigma, math.degrees(sigma)], abs=5e-3
    )
    gaussian = CookTorrance(0.0, 1.0, M, fresnel="schlick", f0=1.0, distribution="gaussian")
    assert fall(TorranceSparrow(1.0, sigma), 0.2) == pytest.approx(fall(gaussian, 0.2), rel=1e-9)

    ratio = numbers(cells("`slope_ratio` σ/τ", "matest `li-torrance`")[0])[0]
    li = LiTorrance(subsurface="off", height_rms=ratio * 5, correlation_length=5.0, masking="off", f0=F0)
    smooth = CookTorrance(0.0, 1.0, M, fresnel="schlick", f0=F0)
    assert fall(li, 0.2) == pytest.approx(fall(smooth, 0.2), rel=1e-9)


@pytest.mark.parametrize(
    "row",
    [
        ("`roughness`", "Mitsuba `principled`"),
        ("`specular_roughness`", "MaterialX `standard_surface`"),
        ("`roughness`", "UsdPreviewSurface"),
        ("`roughnessFactor`", "glTF"),
    ],
    ids=lambda row: row[1],
)
def test_square_roots_are_what_the_page_says(row: tuple[str, str]) -> None:
    assert numbers(cells(*row)[0]) == pytest.approx([math.sqrt(M)], abs=5e-5)


def test_mitsubas_principled_roughness_is_the_root() -> None:
    mi: Any = pytest.importorskip("mitsuba")
    import drjit as dr

    mi.set_variant("scalar_rgb")
    colour = {"type": "rgb", "value": 0.5}
    bsdf = mi.load_dict({"type": "principled", "metallic": 1.0, "roughness": math.sqrt(M), "base_color": colour})
    point = dr.zeros(mi.SurfaceInteraction3f)
    point.wi = mi.Vector3f(0, 0, 1)
    ours = CookTorrance(0.0, 1.0, M, distribution="ggx", masking="smith", fresnel="schlick", f0=0.5)
    normal = along(0.0)
    assert bsdf.eval(mi.BSDFContext(), point, mi.Vector3f(0, 0, 1))[0] == pytest.approx(
        float(ours(normal, normal)), rel=1e-4
    )


@pytest.mark.parametrize("surface", ["standard_surface", "usd_preview_surface"])
def test_materialx_squares_the_roughness_of_its_surfaces(surface: str) -> None:
    mx: Any = pytest.importorskip("MaterialX")
    libraries = Path(mx.__file__).parent / "libraries"
    assert "<roughness_anisotropy" in (libraries / "bxdf" / f"{surface}.mtlx").read_text("utf-8")
    shader = (libraries / "pbrlib" / "genglsl" / "mx_roughness_anisotropy.glsl").read_text("utf-8")
    assert "clamp(roughness*roughness," in shader


def test_exports_have_the_numbers_of_the_page(tmp_path: Path) -> None:
    ggx = CookTorrance(ALBEDO, 1.0, M, distribution="ggx", masking="smith")
    in_mitsuba = mitsuba.write(ggx, tmp_path / "a.xml").parameters
    where = "Mitsuba `roughconductor`, `roughdielectric`, `roughplastic`"
    assert numbers(cells("`alpha`", where)[0]) == pytest.approx([in_mitsuba["alpha"]])
    assert numbers(cells("`reflectance`", "Mitsuba `diffuse`")[0]) == pytest.approx(in_mitsuba["diffuse"])
    assert numbers(cells("`eta`, `k`", "Mitsuba `roughconductor`")[0]) == pytest.approx(
        [in_mitsuba["eta"][0], in_mitsuba["k"][0]]
    )

    in_materialx = materialx.write(ggx, tmp_path / "a.mtlx").parameters
    nodes = "MaterialX `dielectric_bsdf`, `conductor_bsdf`, `generalized_schlick_bsdf`"
    # The export also fits: heights are correlated there.
    assert numbers(cells("`roughness`", nodes)[0]) == pytest.approx([in_materialx["surface_roughness"]] * 2, rel=0.02)
    assert numbers(cells("`ior`", "MaterialX `dielectric_bsdf`")[0]) == pytest.approx([in_materialx["surface_ior"]])
    assert numbers(cells("`color`", "MaterialX `oren_nayar_diffuse_bsdf`")[0]) == pytest.approx(
        in_materialx["body_color"], rel=0.01
    )

    metal = CookTorrance(0.0, 1.0, M, distribution="ggx", masking="smith", fresnel="schlick", f0=ALBEDO)
    in_gltf = gltf.write(metal, tmp_path / "a.glb").parameters
    assert numbers(cells("`roughnessFactor`", "glTF")[0]) == pytest.approx([in_gltf["roughnessFactor"]], abs=5e-5)
    assert numbers(cells("`ior`", "glTF `KHR_materials_ior`")[0]) == pytest.approx(
        [(1 + math.sqrt(F0)) / (1 - math.sqrt(F0))]
    )
    srgb = [round(255 * (1.055 * value ** (1 / 2.4) - 0.055)) for value in ALBEDO]
    assert numbers(cells("base colour texture", "glTF")[0]) == srgb


def test_rough_bodies_have_the_numbers_of_the_page(tmp_path: Path) -> None:
    sigma = math.radians(30)
    clay = OrenNayar(ALBEDO, sigma)
    for row in (
        ("`sigma`", "matest `oren-nayar` and its relatives"),
        ("`roughness`", "MaterialX `oren_nayar_diffuse_bsdf`, `energy_compensation` false"),
    ):
        assert numbers(cells(*row)[0]) == pytest.approx([sigma], abs=5e-5)
    eon = materialx.write(clay, tmp_path / "a.mtlx")
    row = cells("`roughness`", "the same, `energy_compensation` true")
    assert numbers(row[0]) == pytest.approx([eon.parameters["body_roughness"]], rel=0.01)
    assert numbers(row[1].partition("become")[2]) == pytest.approx(
        [*eon.parameters["body_color"], 100 * eon.error.relative_rmse], rel=0.03
    )
    lambert = gltf.write(clay, tmp_path / "a.glb").error.relative_rmse
    assert numbers(cells("–", "Mitsuba, glTF", "–")[0])[-1] == pytest.approx(100 * lambert, rel=0.03)
    cosines = torch.tensor([[1.0], [0.5]], dtype=torch.float64)
    surface = reflectance(OrenNayar(ALBEDO[0], sigma), cosines).flatten().tolist()
    text = cells("`albedo`", "matest `oren-nayar`")[1]
    assert [numbers(text)[0], numbers(text)[2]] == pytest.approx(surface, abs=1e-3)


def test_reflectances_are_what_the_page_says() -> None:
    cosines = torch.tensor([0, 45, 60, 75, 85], dtype=torch.float64).deg2rad().cos()
    exact = dielectric(cosines, torch.tensor(F0, dtype=torch.float64)).tolist()
    schlick = (F0 + (1 - F0) * schlick_weight(1 - cosines)).tolist()
    assert [float(cell) for cell in cells("exact")] == pytest.approx(exact, abs=5e-5)
    assert [float(cell) for cell in cells("Schlick")] == pytest.approx(schlick, abs=5e-5)


def test_two_widths_cost_what_the_page_says(tmp_path: Path) -> None:
    stated = cells(next(line for line in PAGE.splitlines() if line.startswith("| brushed:")).split("|")[1].strip())
    written = [
        mitsuba.write(BRUSHED, tmp_path / "a.xml", fitted=True),
        materialx.write(BRUSHED, tmp_path / "a.mtlx"),
        gltf.write(BRUSHED, tmp_path / "a.glb"),
    ]
    assert (stated[0], stated[-1]) == ("plugin", "refused")
    assert len(mitsuba.write(BRUSHED, tmp_path / "a.xml").files) == 2
    for cell, conversion in zip(stated[2:5], written, strict=True):
        error = conversion.error
        assert numbers(cell) == pytest.approx(
            [100 * error.relative_rmse, 100 * error.median], rel=CONVERSION, abs=CONVERSION_DIGIT
        )
    assert written[1].parameters["surface_roughness"] == pytest.approx(
        [written[0].parameters["alpha"][0], written[0].parameters["alpha"][1]], rel=0.3
    )
    xml = (tmp_path / "a.xml").read_text("utf-8")
    assert "slope_x" in xml


def test_what_materialx_makes_of_eon_is_as_far_off_as_the_page_says() -> None:
    from matest.export.conversion import measured_error

    eon = Eon([0.9, 0.5, 0.3], 0.6)

    def shader(wi: torch.Tensor, wo: torch.Tensor) -> torch.Tensor:
        d = Directions(wi, wo)
        s = (wi * wo).sum(-1, keepdim=True).clamp(min=0) - d.cos_i * d.cos_o
        clamped = torch.where(s > 0, s / torch.maximum(d.cos_i, d.cos_o), s)
        single = eon.albedo * 0.6 / (1 + 0.6 * (0.5 - 2 / (3 * math.pi))) / math.pi
        return eon(wi, wo) + single * (clamped - d.azimuthal)

    error = measured_error(eon, shader).relative_rmse
    assert f"makes {100 * error:.1f} % more error" in re.sub(r"\s+", " ", PAGE)
