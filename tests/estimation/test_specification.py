"""From a model expression and constraints to a problem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import pytest
import torch

from matest.brdf import MODELS, LiTorrance, model
from matest.estimation.options import Options
from matest.estimation.specification import freed, resolve, specify
from matest.parameters import Derived
from tests.captures import refusal

SUM = "oren-nayar+torrance-sparrow"


def specified(expression: str, **options: Any):
    return specify(expression, Options(**options), channels=3, relative=False)


def test_everything_is_free_unless_held_by_default() -> None:
    found = specified("cook-torrance")
    assert found.problem.free == ("diffuse", "specular", "slope")
    assert {name: float(value) for name, value in found.problem.held.items()} == {"f0": 0.04}
    assert found.default_held == ("f0",)


def test_a_fixed_parameter_keeps_the_given_value() -> None:
    found = specified("oren-nayar", fix={"sigma": 0.3})
    assert found.problem.free == ("albedo",)
    assert float(found.problem.held["sigma"]) == 0.3
    assert found.default_held == ()


def test_a_parameter_can_be_fixed_per_channel() -> None:
    found = specified("oren-nayar", fix={"albedo": [0.1, 0.2, 0.3]})
    assert found.problem.held["albedo"].tolist() == [0.1, 0.2, 0.3]


def test_fixing_a_parameter_held_by_default_is_the_users_choice() -> None:
    found = specified("cook-torrance", fix={"f0": 0.1})
    assert float(found.problem.held["f0"]) == 0.1
    assert found.default_held == ()


def test_a_parameter_held_by_default_can_be_freed() -> None:
    found = specified("cook-torrance", free=("f0",))
    assert found.problem.free == ("diffuse", "specular", "slope", "f0")
    assert found.default_held == ()


def test_brackets_of_the_expression_fix_values_and_choose_options() -> None:
    found = specified("lambert+cook-torrance(masking=smith,slope=0.2)")
    assert found.problem.brdf.expression == "lambert+cook-torrance(masking=smith)"
    assert float(found.problem.held["cook-torrance.slope"]) == 0.2


def test_a_fixed_value_overrides_the_brackets() -> None:
    found = specified("oren-nayar(sigma=0.2)", fix={"sigma": 0.4})
    assert float(found.problem.held["sigma"]) == 0.4


def test_a_tied_parameter_is_neither_free_nor_held() -> None:
    problem = specified(SUM, tie={"torrance-sparrow.sigma": "oren-nayar.sigma"}).problem
    assert problem.ties == {"torrance-sparrow.sigma": "oren-nayar.sigma"}
    assert "torrance-sparrow.sigma" not in problem.free
    assert "torrance-sparrow.sigma" not in problem.held


def test_a_parameter_can_be_tied_to_a_fixed_one() -> None:
    problem = specified(SUM, fix={"oren-nayar.sigma": 0.3}, tie={"torrance-sparrow.sigma": "oren-nayar.sigma"}).problem
    values = problem.values(torch.full((problem.size,), 0.5, dtype=torch.float64))
    assert float(values["torrance-sparrow.sigma"]) == 0.3


def test_bare_names_stand_for_the_only_parameter_of_that_name() -> None:
    found = specified(SUM, fix={"specular": 0.1})
    assert float(found.problem.held["torrance-sparrow.specular"]) == 0.1


def test_bare_names_of_several_parameters_are_refused_with_the_paths() -> None:
    message = refusal(lambda: specified(SUM, fix={"sigma": 0.1}))
    assert "oren-nayar.sigma, torrance-sparrow.sigma" in message


@pytest.mark.parametrize("body", ["lambert", "oren-nayar", "oren-nayar-qualitative"])
def test_diffuse_is_zero_beside_another_body(body: str) -> None:
    problem = specified(f"{body}+cook-torrance").problem
    assert float(problem.held["cook-torrance.diffuse"]) == 0
    assert "cook-torrance.diffuse" not in problem.free


def test_diffuse_beside_another_body_stays_zero_when_the_images_could_free_held_parameters() -> None:
    assert specified("lambert+cook-torrance").default_held == ("cook-torrance.f0",)


def test_diffuse_beside_another_body_can_be_asked_for() -> None:
    assert "cook-torrance.diffuse" in specified("lambert+cook-torrance", free=("diffuse",)).problem.free


def test_diffuse_is_free_beside_a_lobe() -> None:
    assert "cook-torrance.diffuse" in specified("torrance-sparrow+cook-torrance").problem.free


def test_freeing_keeps_the_order_of_declaration() -> None:
    wider = freed(specified("lambert+cook-torrance"), ["cook-torrance.f0"])
    assert wider.problem.free == (
        "lambert.albedo",
        "cook-torrance.specular",
        "cook-torrance.slope",
        "cook-torrance.f0",
    )
    assert wider.default_held == ()
    assert set(wider.problem.held) == {"cook-torrance.diffuse"}


def test_relative_radiometry_is_handed_on() -> None:
    found = specify("oren-nayar", Options(), channels=1, relative=True)
    assert found.problem.relative
    assert found.problem.gauges == ["interreflection"]


@pytest.mark.parametrize(
    ("constraints", "expected"),
    [
        ({"fix": {"sigmma": 0.1}}, "did you mean 'sigma'?"),
        ({"free": ("albdo",)}, "did you mean 'albedo'?"),
        ({"tie": {"albedo": "sigmo"}}, "did you mean 'sigma'?"),
        ({"fix": {"zzz": 0.1}}, "known are albedo, sigma"),
    ],
)
def test_unknown_parameters_are_refused_with_the_nearest_name(constraints: dict, expected: str) -> None:
    assert expected in refusal(lambda: specified("oren-nayar", **constraints))


def test_unknown_models_are_refused_with_the_nearest_name() -> None:
    assert "did you mean 'oren-nayar'?" in refusal(lambda: specified("oren-nayer"))


@pytest.mark.parametrize("value", [1.2, -0.1, [0.1, 0.2, 1.3]])
def test_values_outside_their_domain_are_refused(value: object) -> None:
    assert "[0, 1]" in refusal(lambda: specified("oren-nayar", fix={"albedo": value}))


def test_degrees_for_radians_are_pointed_out() -> None:
    assert "radians" in refusal(lambda: specified("oren-nayar", fix={"sigma": 30.0}))


def test_a_value_for_another_number_of_channels_is_refused() -> None:
    assert "3 (one per channel" in refusal(lambda: specified("oren-nayar", fix={"albedo": [0.1, 0.2]}))


@pytest.mark.parametrize(
    "constraints",
    [
        {"tie": {"oren-nayar.sigma": "oren-nayar.sigma"}},
        {"tie": {"torrance-sparrow.sigma": "oren-nayar.sigma", "oren-nayar.sigma": "torrance-sparrow.sigma"}},
        {"tie": {"torrance-sparrow.sigma": "oren-nayar.sigma"}, "fix": {"torrance-sparrow.sigma": 0.1}},
        {"tie": {"torrance-sparrow.sigma": "oren-nayar.sigma"}, "free": ("torrance-sparrow.sigma",)},
    ],
)
def test_ties_that_make_no_sense_are_refused(constraints: dict) -> None:
    assert "--tie" in refusal(lambda: specified(SUM, **constraints))


def test_an_albedo_cannot_be_tied_to_a_parameter_that_all_channels_share() -> None:
    # An angle is one value, an albedo one per channel: neither can take the other's.
    assert "tie" in refusal(lambda: specified("oren-nayar", tie={"sigma": "albedo"}))


def test_fixed_and_free_at_once_is_refused() -> None:
    assert "f0" in refusal(lambda: specified("cook-torrance", fix={"f0": 0.1}, free=("f0",)))


def test_paths_resolve_to_themselves() -> None:
    brdf = model(SUM)[0]
    assert resolve(brdf, "oren-nayar.sigma") == "oren-nayar.sigma"
    assert resolve(brdf, "specular") == "torrance-sparrow.specular"


def test_a_ratio_that_results_report_can_be_fixed() -> None:
    found = specified("li-torrance", fix={"slope_ratio": 0.25})
    assert float(found.problem.held["correlation_length"]) == 4.0
    assert "correlation_length" not in found.problem.free
    beside = specified("li-torrance", fix={"slope_ratio": 0.25, "height_rms": 0.5})
    assert float(beside.problem.held["correlation_length"]) == 2.0
    bracketed = specified("li-torrance(height_rms=2)", fix={"slope_ratio": 0.5})
    assert float(bracketed.problem.held["correlation_length"]) == 4.0
    inside = specified("lambert+li-torrance", fix={"slope_ratio": 0.25})
    assert float(inside.problem.held["li-torrance.correlation_length"]) == 4.0


@dataclass(frozen=True, eq=False)
class Bumpy(LiTorrance):
    """A rough surface that tells of another quantity."""

    name: ClassVar[str] = "bumpy"
    quantities: ClassVar[tuple[Derived, ...]] = (
        Derived(
            "bump_volume",
            unit="µm³",
            doc="",
            value=lambda values: values["height_rms"] * values["correlation_length"].square(),
            sets="correlation_length",
            inverse=lambda volume, others: (volume / others["height_rms"]).sqrt(),
            when={"anisotropy": ("none",)},
        ),
    )


def test_a_derived_quantity_that_is_fixed_gives_the_parameter_it_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(MODELS, "bumpy", Bumpy)
    found = specified("lambert+bumpy", fix={"bump_volume": 18.0, "height_rms": 2.0})
    assert float(found.problem.held["bumpy.correlation_length"]) == 3.0
    sources = ("bumpy.height_rms", "bumpy.correlation_length")
    assert found.problem.brdf.structure.derived == {"bumpy.bump_volume": sources}
    message = refusal(lambda: specified("lambert+bumpy", fix={"bump_volume": 0.5}))
    assert "between 1 and 10000 (bumpy.height_rms is 1 µm)" in message
    assert not Bumpy(anisotropy="printed").derived


def test_a_quantity_names_the_parameter_that_only_it_tells_of() -> None:
    chosen = specified("lambert+li-torrance").problem
    assert chosen.quantity("li-torrance.correlation_length").name == "li-torrance.slope_ratio"
    assert chosen.quantity("li-torrance.height_rms") is None
    assert specified("li-torrance", fix={"height_rms": 1.0}).problem.quantity("correlation_length") is None
    assert specified("li-torrance(coherent=on)").problem.quantity("correlation_length") is None


def test_a_ratio_and_a_length_in_brackets_say_the_same() -> None:
    assert "the same" in refusal(lambda: specified("li-torrance(correlation_length=3)", fix={"slope_ratio": 0.3}))


@pytest.mark.parametrize(
    ("fix", "free", "word"),
    [
        ({"slope_ratio": 0.001}, (), "between 0.01 and 1"),
        ({"slope_ratio": -0.2}, (), "between"),
        ({"slope_ratio": [0.1, 0.2, 0.3]}, (), "one number"),
        ({"slope_ratio": 0.3, "correlation_length": 4.0}, (), "the same"),
        ({"slope_ratio": 0.3}, ("height_rms",), "height_rms has to be fixed"),
        ({"slop_ratio": 0.3}, (), "did you mean 'slope_ratio'"),
    ],
)
def test_a_ratio_that_cannot_be_held_is_refused(fix: dict, free: tuple[str, ...], word: str) -> None:
    assert word in refusal(lambda: specified("li-torrance", fix=fix, free=free))
