"""Parameters that several models share."""

from __future__ import annotations

import dataclasses

import pytest

from matest.brdf import MODELS, declarations
from matest.parameters import OPTICS, Role, parameters_of


@dataclasses.dataclass
class Everything:
    """One parameter of each kind."""

    albedo: float = declarations.albedo()
    diffuse: float = declarations.diffuse()
    interreflection: float = declarations.interreflection()
    slope: float = declarations.slope("", 0.2)
    f0: float = declarations.f0()
    wavelength: float = declarations.wavelength()
    solid_angle: float = declarations.solid_angle()


SHARED = parameters_of(Everything)


def test_what_light_and_camera_give_is_held_where_they_do_not_give_it() -> None:
    assert {name for name, declared in SHARED.items() if declared.role in OPTICS} == {"wavelength", "solid_angle"}
    assert (SHARED["wavelength"].held, SHARED["solid_angle"].held, SHARED["f0"].held) == (0.55, 5e-4, 0.04)
    assert {name for name, declared in SHARED.items() if declared.per_channel} == {"albedo", "diffuse"}


@pytest.mark.parametrize("name", SHARED)
def test_a_name_has_one_meaning_in_every_model(name: str) -> None:
    shared = SHARED[name]
    for model in MODELS.values():
        declared = parameters_of(model).get(name)
        if declared is not None:
            assert (declared.unit, declared.role, declared.domain) == (shared.unit, shared.role, shared.domain), model


def test_roles_are_declared_and_not_read_from_names() -> None:
    roles = {name: declared.role for name, declared in SHARED.items() if declared.role is not Role.NONE}
    assert roles == {
        "diffuse": Role.BODY,
        "interreflection": Role.GAUGE,
        "f0": Role.FRESNEL,
        "slope": Role.SLOPE,
        "wavelength": Role.WAVELENGTH,
        "solid_angle": Role.SOLID_ANGLE,
    }
