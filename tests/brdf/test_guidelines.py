"""The components that a surface needs, by the guidelines of Li and Torrance."""

from __future__ import annotations

from matest.brdf.guidelines import assemble


def test_guidelines_choose_the_components() -> None:
    rough_metal = assemble(metal=True, rough=True)
    assert rough_metal.model.expression == "li-torrance(uniform=on,subsurface=off)"
    smooth_metal = assemble(metal=True, rough=False, mirror_at_grazing=True)
    assert smooth_metal.model.expression == "li-torrance(masking=off,subsurface=off,coherent=on)"
    paint = assemble(metal=False, rough=True, forward_scattering=True)
    assert paint.model.expression == "li-torrance(forward=on)"
    chalk = assemble(metal=False, rough=True, angular_variation=False)
    assert chalk.model.expression == "li-torrance(directional=off)"
    assert set(paint.reasons) == {
        "coherent", "directional", "uniform", "subsurface", "forward", "masking", "fresnel"
    }  # fmt: skip
    assert all(reason for reason in paint.reasons.values())


def test_masking_is_left_out_where_no_direction_is_low_and_the_reason_says_so() -> None:
    without = assemble(metal=False, rough=True, masked=False)
    assert without.model.expression == "li-torrance(masking=off)"
    assert without.reasons["masking"] == "eq. 7: S > 0.99 at all directions used"
    smooth = assemble(metal=False, rough=False)
    assert smooth.reasons["masking"] == "C: negligible on a smooth or slightly rough surface"


def test_a_reason_against_a_component_differs_from_the_reason_for_it() -> None:
    present, missing = (assemble(metal=False, rough=True, forward_scattering=forward) for forward in (True, False))
    assert present.reasons["forward"] == "F: measurements show it"
    assert missing.reasons["forward"] == "F: only on evidence from measurements"
    metal = assemble(metal=True, rough=True, forward_scattering=True)
    assert metal.reasons["forward"] == metal.reasons["subsurface"] == "no light leaves a metal that has entered it"
