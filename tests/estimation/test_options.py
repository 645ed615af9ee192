"""The same options mean the same wherever they are given, and are refused in the same words."""

from __future__ import annotations

import importlib
import pickle
from dataclasses import FrozenInstanceError

import pytest

import matest
from matest.brdf import Lambert, OrenNayar
from matest.estimation.estimate import estimate_with
from matest.estimation.options import Options
from matest.estimation.specification import check_options
from matest.samples.uncertainty import NAMES, Uncertainty
from tests.captures import refusal
from tests.simulated import Studio

CAPTURE = Studio(size=24)


def test_options_can_be_sent_to_another_process_and_not_be_changed() -> None:
    options = Options(
        model="oren-nayar", fix={"albedo": [0.1, 0.2, 0.3]}, free=("sigma",), tie={"a": "b"}, holdout=(1,),
        precision=0.01, seed=3, device="cuda", transfer=2.2, uncertainty=Uncertainty(direction=0.01), refine=("blur",),
    )  # fmt: skip
    assert pickle.loads(pickle.dumps(options)) == options
    with pytest.raises(FrozenInstanceError):
        options.seed = 1  # type: ignore[misc]


@pytest.mark.parametrize("precision", [0.0, 1.0, -0.1, float("nan")])
def test_a_precision_that_is_no_relative_error_is_refused_before_anything_is_read(precision: float) -> None:
    assert "between 0 and 1" in refusal(lambda: Options(precision=precision))


def test_a_negative_seed_is_refused_before_anything_is_read() -> None:
    assert "--seed" in refusal(lambda: Options(seed=-1))


@pytest.mark.parametrize("model", ["Auto", "AUTO", "atuo", "Auto(distribution=any)"])
def test_a_slip_in_the_name_of_auto_is_refused_with_the_right_one(model: str) -> None:
    assert refusal(lambda: Options(model=model)) == f"--model {model}: unknown model; did you mean 'auto'?"


def test_errors_to_refine_are_families_by_name() -> None:
    assert Options(refine=("blur", "black")).refine == ("blur", "black")
    assert Options(refine=("all",)).refine == tuple(NAMES)
    assert Options(refine="blur, black").refine == ("blur", "black")
    assert not Options(refine=("shift",) * len(NAMES)).refines_all
    assert refusal(lambda: Options(refine="")).startswith("--refine: it names no errors")
    expected = "--refine: unknown uncertainty 'bluur'; did you mean 'blur'?"
    assert refusal(lambda: Options(refine=("bluur",))) == expected


def test_an_estimate_takes_uncertainties_by_name_or_as_a_capture_states_them(monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module("matest.estimation.estimate")
    monkeypatch.setattr(module, "estimate_with", lambda _, options, __: options)
    capture = CAPTURE.photograph(Lambert(0.5), seed=1)
    stated = Uncertainty(pose=(0.5, 0.01))
    for uncertainty in (stated, {"pose": [0.5, 0.01]}):
        options = matest.estimate(capture, uncertainty=uncertainty, refine=["pose"])
        assert options == Options(model="auto", uncertainty=stated, refine=("pose",))
    assert matest.estimate(capture, refine="all").refine == tuple(NAMES)
    assert matest.estimate(capture, refine="pose,blur").refine == ("pose", "blur")
    assert "direction" in refusal(lambda: matest.estimate(capture, uncertainty={"directoin": 0.1}))
    expected = "--uncertainty: what is stated are numbers by name, as {'direction': 0.01}; got ['direction']."
    assert refusal(lambda: matest.estimate(capture, uncertainty=["direction"])) == expected  # type: ignore[arg-type]


def test_images_left_out_are_those_of_the_capture() -> None:
    assert Options(holdout=(1,)).fitted_images(3) == (0, 2)
    assert Options().fitted_images(2) == (0, 1)
    assert "0 to 2" in refusal(lambda: Options(holdout=(3,)).fitted_images(3))
    assert "at least one" in refusal(lambda: Options(holdout=(0, 1)).fitted_images(2))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (Options(model="orennayar"), "did you mean 'oren-nayar'?"),
        (Options(model="oren-nayar", fix={"sigmma": 0.3}), "did you mean 'sigma'?"),
        (Options(model="oren-nayar", free=("slope",)), "slope"),
        (Options(model="oren-nayar", tie={"sigma": "albedo"}), "--tie"),
        (Options(model="oren-nayar", fix={"albedo": 0.5, "sigma": 0.3}), "none is left to estimate"),
        (Options(device="cuda:9"), "--device cuda:9"),
    ],
)
def test_what_no_capture_can_make_right_is_refused_without_one(options: Options, words: str) -> None:
    assert words in refusal(lambda: check_options(options))


def test_values_a_channel_are_no_mistake_before_the_channels_are_known() -> None:
    check_options(Options(model="oren-nayar", fix={"albedo": [0.5, 0.4, 0.3]}))
    check_options(Options(fix={"sigma": 0.3}))


@pytest.mark.parametrize(
    "options", [{"fix": {"sigmma": 0.3}}, {"fix": {"sigma": 40.0}}, {"free": ("slope",)}, {"tie": {"sigma": "albedo"}}]
)
def test_estimate_and_check_refuse_the_same_options_in_the_same_words(options: dict) -> None:
    capture = CAPTURE.photograph(Lambert(0.5), seed=1)
    said = refusal(lambda: matest.estimate(capture, "oren-nayar", **options))
    assert refusal(lambda: matest.check(capture, "oren-nayar", **options)) == said


def test_estimate_and_check_hold_the_same_values(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("matest.identifiability.advice.next_light", lambda *_: None)
    capture = CAPTURE.photograph(OrenNayar(0.6, 0.4), seed=1)
    found = matest.estimate(capture, "oren-nayar", fix={"sigma": 0.4})
    forecast = matest.check(capture, "oren-nayar", fix={"sigma": 0.4})
    for name in ("albedo", "sigma"):
        assert (found.parameters[name].status == "fixed") == (forecast.parameters[name].status == "fixed")
    assert forecast.parameters["sigma"].value == found.parameters["sigma"].value == pytest.approx(0.4)


def test_an_estimate_takes_its_arguments_as_options() -> None:
    capture = CAPTURE.photograph(OrenNayar(0.6, 0.4), seed=1)
    options = Options(model="oren-nayar", fix={"sigma": 0.4}, holdout=(0,), seed=5)
    one = estimate_with(capture, options)
    other = matest.estimate(capture, "oren-nayar", fix={"sigma": 0.4}, holdout=[0], seed=5)
    assert one.holdout == other.holdout
    assert one.parameters == other.parameters


def test_a_model_that_nobody_named_is_chosen_by_the_images() -> None:
    assert Options().automatic
    assert Options(model="auto").automatic
    assert not Options(model="lambert").automatic
    capture = CAPTURE.photograph(Lambert(0.5), seed=1)
    assert estimate_with(capture, Options(fix={"sigma": 0.2})).candidates
