"""The Mitsuba writer: what Mitsuba itself evaluates, samples and renders."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import torch

from matest.benchmark.instruments.rendition import difference, load, rendered
from matest.brdf import BlinnPhong, Brdf, CookTorrance, Lambert, OrenNayar
from matest.directions import Directions, from_angles, to_local
from matest.errors import InputError
from matest.export import mitsuba
from matest.export.conversion import pairs
from matest.scene import Camera
from matest.scene.surface import from_mesh, from_sphere
from tests.export.materials import BRUSHED, FOAM, GLOSS, METAL, NATIVE, PAPER, PLUGGED, SMITH_GLOSS, even_pairs
from tests.export.two_tone import SHAPE, camera, textured, to_edge, truth, vase

pytest.importorskip("mitsuba")
# Single precision, and the rounding of values to nine digits.
ROUNDING = 1e-5
# Walter's rational function for Smith's masking of Beckmann's facets, on both sides.
RATIONAL_MASKING = 0.008
SIZE = 40


@pytest.fixture(scope="module")
def mi() -> Any:
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    return mi


def loaded(material: Brdf, folder: Path, **options: Any) -> tuple[Any, Any]:
    """The BSDF that Mitsuba makes of the file, with the plugin if there is one, and what the writer says."""
    conversion = mitsuba.write(material, folder / "ball.xml", **options)
    return load(conversion.files), conversion


def evaluated(mi: Any, bsdf: Any, wi: torch.Tensor, wo: torch.Tensor) -> torch.Tensor:
    """f [n, 3] by Mitsuba, which multiplies it by cos θi."""
    import drjit as dr

    context, point, values = mi.BSDFContext(), dr.zeros(mi.SurfaceInteraction3f), []
    for light, viewer in zip(wi.tolist(), wo.tolist(), strict=True):
        point.wi = mi.Vector3f(viewer)
        values.append(np.array(bsdf.eval(context, point, mi.Vector3f(light))) / light[2])
    return torch.from_numpy(np.array(values, dtype=float))


@pytest.mark.parametrize("name", PLUGGED)
def test_the_plugin_evaluates_the_material_itself(mi: Any, name: str, tmp_path: Path) -> None:
    material, sample = PLUGGED[name], pairs(300, seed=3)
    bsdf, conversion = loaded(material, tmp_path)
    assert [file.name for file in conversion.files] == ["ball.xml", "matest_bsdf.py"]
    truth = material(sample.wi, sample.wo).expand(-1, 3)
    torch.testing.assert_close(evaluated(mi, bsdf, sample.wi, sample.wo), truth, rtol=ROUNDING, atol=1e-7)


@pytest.mark.parametrize("name", NATIVE)
def test_lobes_that_mitsuba_has_are_converted_exactly(mi: Any, name: str, tmp_path: Path) -> None:
    material, sample = NATIVE[name], pairs(1000, seed=3)
    bsdf, conversion = loaded(material, tmp_path)
    assert [file.name for file in conversion.files] == ["ball.xml"]
    values = evaluated(mi, bsdf, sample.wi, sample.wo)
    truth = material(sample.wi, sample.wo).expand(-1, 3)
    assert float((values / truth - 1)[truth > 1e-4].abs().max()) < RATIONAL_MASKING
    assert conversion.error.relative_rmse < 0.005


@pytest.mark.parametrize("material", [GLOSS, FOAM, PAPER, BRUSHED], ids=["gloss", "foam", "paper", "brushed"])
def test_the_error_of_a_fit_is_what_mitsuba_shows(mi: Any, material: Brdf, tmp_path: Path) -> None:
    bsdf, conversion = loaded(material, tmp_path, fitted=True)
    wi, wo = even_pairs(8_000)
    truth, values = material(wi, wo).expand(-1, 3), evaluated(mi, bsdf, wi, wo)
    squares = [float((part * wi[:, 2:]).square().sum()) for part in (values - truth, truth)]
    # Random pairs: those in the peak of a lobe are some hundreds.
    assert math.sqrt(squares[0] / squares[1]) == pytest.approx(conversion.error.relative_rmse, rel=0.15)
    assert str(conversion.error) in conversion.files[0].read_text("utf-8")
    assert len(conversion.files) == 1


@pytest.mark.parametrize(
    ("material", "largest"),
    [(GLOSS, ROUNDING), (SMITH_GLOSS, 0.01), (METAL, 0.01), (FOAM, ROUNDING), (PAPER, ROUNDING)],
    ids=["gloss", "smith-gloss", "metal", "foam", "paper"],
)
def test_a_sphere_that_mitsuba_renders_is_ours_pixel_by_pixel(material: Brdf, largest: float, tmp_path: Path) -> None:
    bsdf, _ = loaded(material, tmp_path)
    surface = from_sphere((SIZE, SIZE), (SIZE / 2, SIZE / 2), SIZE / 2, None)
    toward = np.array([0.5, 0.3, 0.81])
    seen = Camera((0.0, 0.0, 5.0), height=2.0)
    found = difference({"type": "sphere", "bsdf": bsdf}, material, surface, seen, [toward / np.linalg.norm(toward)])
    # Positions on the sphere are single precision: a lobe's flank turns that into some more digits.
    assert found.largest < largest + 2e-4


@pytest.mark.parametrize(
    ("material", "name"),
    [(SMITH_GLOSS, "diffuse"), (Lambert(0.5), "albedo"), (OrenNayar(0.5, 0.5), "albedo"), (GLOSS, "specular")],
    ids=["native", "lambert", "plugin", "specular"],
)
def test_a_mesh_with_textures_that_mitsuba_renders_is_ours_pixel_by_pixel(
    material: Brdf, name: str, tmp_path: Path
) -> None:
    made = textured(material, name, exact=True)
    shape, conversion = loaded(made.material, tmp_path, textured=made)
    seen, toward = camera(0), np.array([0.3, 0.4, 0.85])
    toward /= np.linalg.norm(toward)
    surface = from_mesh(vase(), seen, SHAPE)
    assert surface.positions is not None
    image = rendered(shape, seen, toward, SHAPE)
    points = surface.positions.numpy()
    albedo = torch.from_numpy(truth(points))
    own = material.replace({name: albedo})
    wi, wo = to_local(
        surface.normals, *(v.expand_as(surface.normals) for v in (torch.from_numpy(toward), surface.view))
    )
    ours = (own(wi, wo) * wi[:, 2:].clamp(min=0)).numpy()
    kept = (to_edge(points) > 0.05) & ~surface.rim & (ours > 0.01).all(axis=1)
    error = image.reshape(-1, 3)[surface.pixels][kept] / ours[kept] - 1
    assert kept.mean() > 0.4
    assert np.abs(error).max() < max(RATIONAL_MASKING, 3 * conversion.error.relative_rmse) + 2e-3
    assert np.median(np.abs(error)) < 1e-3


def test_textures_do_not_go_with_lobes_that_must_be_fitted(tmp_path: Path) -> None:
    made = textured(BlinnPhong(0.2, 0.3), "diffuse")
    with pytest.raises(
        InputError, match=r"lobes must be fitted to blinn-phong, which gives no textures; write them with --to"
    ):
        mitsuba.write(made.material, tmp_path / "ball.xml", textured=made)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["v-cavities", "ggx-schlick", "laser-paper", "brushed"])
def test_directions_are_drawn_by_the_density_that_the_plugin_states(mi: Any, name: str, tmp_path: Path) -> None:
    import drjit as dr

    bsdf, _ = loaded(PLUGGED[name], tmp_path)
    context, point = mi.BSDFContext(), dr.zeros(mi.SurfaceInteraction3f)
    cos = math.cos(0.6)
    point.wi = mi.Vector3f(math.sin(0.6), 0.0, cos)
    uniform = np.random.default_rng(2).random((6000, 3))
    weights = [bsdf.sample(context, point, float(u), mi.Point2f(v, w))[1] for u, v, w in uniform]
    mean = np.array(weights).mean(0)
    # By Gauss-Legendre nodes over the lights, in cosine and azimuth.
    nodes, shares = (torch.from_numpy(each) for each in np.polynomial.legendre.leggauss(240))
    height, azimuth = torch.meshgrid((nodes + 1) / 2, math.pi * (nodes + 1), indexing="ij")
    wi = from_angles(height.acos().flatten(), azimuth.flatten())
    wo = torch.tensor([[math.sin(0.6), 0.0, cos]], dtype=torch.float64).expand_as(wi)
    weight = math.pi / 2 * torch.outer(shares, shares).flatten()
    albedo = (PLUGGED[name](wi, wo).expand(-1, 3) * (wi[:, 2] * weight)[:, None]).sum(0).numpy()
    assert mean == pytest.approx(albedo, rel=0.04)


def test_values_of_the_plugin_can_be_traversed(mi: Any, tmp_path: Path) -> None:
    bsdf, _ = loaded(FOAM, tmp_path)
    names = {key for key, _ in mi.traverse(bsdf).items()}
    assert {"lobe_0_albedo.value", "lobe_0_sigma.value", "lobe_1_slope.value"} <= names


def test_alpha_is_the_slope(mi: Any) -> None:
    facets = torch.tensor([0.0, 0.1, 0.2, 0.4], dtype=torch.float64)
    half = torch.stack([facets.sin(), torch.zeros_like(facets), facets.cos()], -1)
    # Light and viewer on the half vector: with F = 1 what is left of f is D G/(4 cos²).
    for name in ("beckmann", "ggx"):
        kind = mi.MicrofacetType.Beckmann if name == "beckmann" else mi.MicrofacetType.GGX
        theirs = [mi.MicrofacetDistribution(kind, 0.15).eval(mi.Vector3f(h)) for h in half.tolist()]
        white = CookTorrance(0.0, 1.0, 0.15, fresnel="schlick", f0=1.0, distribution=name)
        free = Directions(half, half).cos_i[:, 0].square() * 4
        # V-cavities mask nothing where light and viewer are on the half vector of a facet that is not steep.
        ours = white(half, half)[:, 0] * free
        assert theirs == pytest.approx(ours.tolist(), rel=1e-5)


def test_the_plugin_beside_a_scene_needs_mitsuba_alone(tmp_path: Path) -> None:
    plugin = mitsuba.write(GLOSS, tmp_path / "ball.xml").files[1]
    imports = [line for line in plugin.read_text("utf-8").splitlines() if line.startswith(("import ", "from "))]
    assert not any("matest" in line for line in imports)
    assert "matest.export.mitsuba_plugin" not in sys.modules


def test_a_scene_may_include_the_file(mi: Any, tmp_path: Path) -> None:
    mitsuba.write(Lambert(0.5), tmp_path / "ball.xml")
    scene = '<scene version="3.0.0"><include filename="ball.xml"/><shape type="sphere"><ref id="ball"/></shape></scene>'
    (tmp_path / "scene.xml").write_text(scene)
    assert len(mi.load_file(str(tmp_path / "scene.xml")).shapes()) == 1


def test_the_file_says_what_it_is(tmp_path: Path) -> None:
    mitsuba.write(SMITH_GLOSS, tmp_path / "ball.xml")
    root = ElementTree.fromstring((tmp_path / "ball.xml").read_text("utf-8"))
    assert root.attrib == {"type": "blendbsdf", "version": "3.0.0", "id": "ball"}
    remark = "<!-- cook-torrance(masking=smith) by matest; error of the conversion 0.2"
    assert remark in (tmp_path / "ball.xml").read_text("utf-8")


def test_other_channels_than_rgb_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ball.xml: Mitsuba's RGB has the channels R, G, B, and the material has 5"):
        mitsuba.write(Lambert([0.1, 0.2, 0.3, 0.4, 0.5]), tmp_path / "ball.xml")
    assert not list(tmp_path.iterdir())
