"""The strings that name models."""

from __future__ import annotations

import pytest

from matest.brdf import MODELS, CookTorrance, Lambert, OrenNayar, Sum, TorranceSparrow, model, variants
from matest.brdf.expression import number
from matest.errors import InputError


@pytest.mark.parametrize("name", MODELS)
def test_every_name_in_the_catalogue_is_its_model(name: str) -> None:
    brdf, fixed = model(name)
    assert type(brdf) is MODELS[name]
    assert brdf.name == name
    assert fixed == {}


@pytest.mark.parametrize(
    "expression", [*variants(), "oren-nayar+torrance-sparrow", "lambert+cook-torrance(masking=smith)"]
)
def test_expression_of_a_model_names_it_again(expression: str) -> None:
    assert model(expression)[0].expression == expression


def test_plus_makes_a_sum_in_the_order_written() -> None:
    brdf, _ = model("torrance-sparrow+lambert")
    assert isinstance(brdf, Sum)
    assert [type(part) for part in brdf.components] == [TorranceSparrow, Lambert]


def test_brackets_choose_options() -> None:
    brdf, fixed = model("cook-torrance(masking=smith, normalisation=ngan)")
    assert isinstance(brdf, CookTorrance)
    assert (brdf.masking, brdf.normalisation) == ("smith", "ngan")
    assert fixed == {}


def test_brackets_fix_parameters_of_a_single_model_by_name() -> None:
    brdf, fixed = model("cook-torrance(f0=0.05,masking=smith)")
    assert fixed == {"f0": 0.05}
    assert brdf.expression == "cook-torrance(masking=smith)"


def test_brackets_fix_parameters_of_a_sum_by_path() -> None:
    _, fixed = model("oren-nayar(sigma=0.3)+torrance-sparrow(sigma=0.2)")
    assert fixed == {"oren-nayar.sigma": 0.3, "torrance-sparrow.sigma": 0.2}


def test_interreflection_is_switched_by_a_word() -> None:
    brdf, fixed = model("oren-nayar(interreflection=false)")
    assert isinstance(brdf, OrenNayar)
    assert fixed == {"interreflection": 0.0}
    assert model("oren-nayar(interreflection=true)")[1] == {"interreflection": 1.0}


def test_spaces_do_not_matter() -> None:
    spaced, fixed = model("  lambert + cook-torrance ( masking = smith , f0 = 0.1 ) ")
    assert spaced.expression == "lambert+cook-torrance(masking=smith)"
    assert fixed == {"cook-torrance.f0": 0.1}


def test_exponents_of_numbers_do_not_split_the_sum() -> None:
    assert model("cook-torrance(slope=1e-1)")[1] == {"slope": 0.1}
    assert model("lambert+cook-torrance(slope=1e+0)")[1] == {"cook-torrance.slope": 1.0}


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("oren-nayer", "unknown model 'oren-nayer'; did you mean 'oren-nayar'?"),
        ("velvet", "unknown model 'velvet'; known are lambert, "),
        ("lambert+cook-torance", "did you mean 'cook-torrance'?"),
        ("cook-torrance(maskin=smith)", "cook-torrance has no option or parameter 'maskin'; did you mean 'masking'?"),
        ("oren-nayar(sigm=0.3)", "oren-nayar has no option or parameter 'sigm'; did you mean 'sigma'?"),
        ("cook-torrance(masking=shadow)", "masking must be one of v-cavity, smith; got 'shadow'"),
        ("cook-torrance(smith)", "'smith' in the brackets must read name=value"),
        ("oren-nayar(sigma=rough)", "oren-nayar: sigma must be a number; got 'rough'"),
        ("oren-nayar(sigma=30)", "oren-nayar: sigma must lie in [0, 1.57] rad; got 30.0. Angles are in radians."),
        ("oren-nayar(sigma=nan)", "sigma must lie in"),
        ("lambert+lambert", "repeats lambert"),
        ("lambert(albedo=0.5", "cannot be read at 'lambert(albedo=0.5'"),
        ("lambert+", "cannot be read at ''"),
        ("", "cannot be read at ''"),
    ],
)
def test_errors_say_what_came_and_what_was_expected(expression: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        model(expression)
    assert message in str(caught.value)


@pytest.mark.parametrize(("text", "value"), [("0.5", 0.5), ("1e-3", 1e-3), ("true", 1.0), ("False", 0.0)])
def test_numbers_may_be_words(text: str, value: float) -> None:
    assert number(text, "sigma") == value
