"""Rules of an estimate follow what a model declares of its parameters, whatever it calls them."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import ClassVar

import pytest
import torch
from torch import Tensor

import matest
from matest.brdf import MODELS, Brdf, CookTorrance, Term
from matest.brdf.fresnel import schlick_weight
from matest.brdf.microfacet import beckmann, v_cavity
from matest.brdf.terms import complement_of
from matest.directions import Directions
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.parameters import Role, interval, parameter, unit_interval
from tests.simulated import Studio

STUDIO = Studio(size=32)


@dataclass(frozen=True, eq=False)
class Dummy(Brdf):
    """A body and a highlight, under names of its own."""

    kd: Tensor = parameter(unit_interval, unit="1", doc="", default=0.5, per_channel=True, role=Role.BODY)
    ks: Tensor = parameter(unit_interval, unit="1", doc="", default=0.5, per_channel=True)
    m: Tensor = parameter(interval(0.01, 1), unit="1", doc="", default=0.3, log=True)
    r0: Tensor = parameter(unit_interval, unit="1", doc="", default=0.04, held=0.04, log=True, role=Role.FRESNEL)
    lam: Tensor = parameter(interval(0.2, 2), unit="µm", doc="", default=0.55, held=0.55, role=Role.WAVELENGTH)
    omega: Tensor = parameter(interval(0, 1), unit="sr", doc="", default=0.01, held=0.01, role=Role.SOLID_ANGLE)

    name: ClassVar[str] = "dummy"
    source: ClassVar[str] = ""

    def terms(self, directions: Directions) -> tuple[Term, ...]:
        lobe = beckmann(directions, self.m + 0.01 * (self.lam - 0.55) + 0.01 * self.omega) * v_cavity(directions)
        return (
            Term(("kd",), torch.full_like(lobe, 1 / math.pi)),
            Term(("ks", "r0"), lobe),
            Term(("ks", complement_of("r0")), lobe * schlick_weight(directions.short_d)),
        )


@pytest.fixture(autouse=True)
def _catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(MODELS, "dummy", Dummy)


def test_a_body_by_any_name_is_left_out_beside_a_diffuse_model() -> None:
    beside = specify("lambert+dummy", Options(), channels=1, relative=False).problem
    assert float(beside.held["dummy.kd"]) == 0
    assert "kd" in specify("dummy", Options(), channels=1, relative=False).problem.free
    assert "dummy.kd" in specify("torrance-sparrow+dummy", Options(), channels=1, relative=False).problem.free


def test_optics_by_any_name_come_from_the_capture_that_says_them() -> None:
    scene = STUDIO.scene
    lights = tuple(tuple(dataclasses.replace(light, solid_angle=0.02) for light in image) for image in scene.lights)
    said = dataclasses.replace(scene, lights=lights, wavelength=torch.tensor([0.6], dtype=torch.float64))
    found = specify("dummy", Options(), channels=1, relative=False, scene=said)
    assert found.problem.held["lam"].tolist() == [0.6]
    assert float(found.problem.held["omega"]) == 0.02
    assert found.default_held == ("r0",)


def test_warnings_know_what_a_parameter_is_from_its_role() -> None:
    metal = CookTorrance(diffuse=0.0, specular=1.0, slope=0.3, f0=0.9, fresnel="schlick")
    found = matest.estimate(STUDIO.photograph(metal, seed=1), "lambert+dummy")
    told = " ".join(found.warnings)
    assert "dummy.r0 is held at 0.04: these images do not determine it beside the strength of the highlight" in told
    assert "dummy.ks is at its upper end: with dummy.r0 held at 0.04 no lobe is bright enough" in told
    assert "dummy.lam is taken as 0.55 µm: [camera] of the capture should say it." in told
    assert "dummy.omega is taken as 0.01 sr: the lights of the capture should say it." in told
    assert "dummy.kd: another component is the diffuse one" in found.skipped["work"]
