"""A check as the terminal shows it."""

from __future__ import annotations

import math
from dataclasses import replace
from io import StringIO

from rich.console import Console

from matest.identifiability import Check, LightAdvice, Prediction
from matest.report.identifiability import _least_known, check_report

LIGHT = LightAdvice(
    direction=(0.6, 0.0, 0.8),
    from_camera=math.acos(0.8),
    azimuth=-math.pi / 2,
    irradiance=[3.0],
    std={"albedo": [0.01, 0.02], "sigma": 0.1, "f0": None},
    worst=(0.5, 0.2),
    gain={"albedo": 2.0, "sigma": None, "f0": None},
    resolves=[],
    frees=[],
    freed={},
)
CHECK = Check(
    capture="vase",
    model="lambert",
    parameters={
        "albedo": Prediction([0.5, 0.4], [0.02, 0.04], 0.1, (0.05, None), "1", "determined"),
        "sigma": Prediction(0.3, None, None, None, "rad", "not determined", "nothing shows it"),
        "f0": Prediction(0.04, None, None, None, "1", "held"),
    },
    light=LIGHT,
    images=1,
    samples=12345,
    skipped={},
    noise={"read": 0.001, "gain": 0.0001, "source": "as given"},
    highlight=None,
    levels={"sigma": [0.15, 0.3, 0.6]},
    warnings=["No mesh."],
)


def words(check: Check) -> str:
    console = Console(file=StringIO(), width=200, highlight=False)
    console.print(check_report(check))
    return " ".join(console.file.getvalue().split())  # type: ignore[attr-defined]


def test_a_check_shows_errors_reasons_levels_and_what_they_rest_on() -> None:
    text = words(CHECK)
    for part in (
        "albedo 0.5, 0.4 ± 0.04 10% (5% to -) determined",
        "sigma (not determined): nothing shows it.",
        "Range: over sigma 0.15 to 0.6; --at NAME=VALUE predicts for another value.",
        "12,345 samples of 1 image; noise as given: read 0.001, gain 0.0001 of full scale.",
        "Note: No mesh.",
    ):
        assert part in text


def test_a_light_is_described_as_seen_from_the_camera_with_what_it_brings() -> None:
    text = words(CHECK)
    assert (
        "37° off the camera, 270° counterclockwise from the image's right: largest relative error 50% -> 20%." in text
    )
    assert "albedo ± 0.04 ± 0.02 2 ×" in text
    assert "from the camera itself" in words(replace(CHECK, light=replace(LIGHT, from_camera=0.0)))
    assert "No further distant light" in words(replace(CHECK, light=None))


def test_a_light_that_resolves_or_frees_parameters_says_so() -> None:
    text = words(replace(CHECK, light=replace(LIGHT, resolves=["sigma"], frees=["f0"], freed={"f0": 0.002})))
    assert "becomes determined" in text
    assert "With it f0 will be estimated too, no longer taken for granted: f0 ± 0.002. --fix f0=VALUE keeps" in text
    assert "largest relative error" not in text


def test_error_and_relative_error_are_those_of_one_channel() -> None:
    assert _least_known([0.5, 0.1], [0.02, 0.01]) == 0.01
    assert _least_known([0.5, None], [0.02, None]) is None
    assert _least_known(0.3, 0.1) == 0.1


def test_both_tables_give_the_error_of_the_same_channel_and_say_which() -> None:
    albedo = Prediction([0.5, 0.1], [0.02, 0.01], 0.1, None, "1", "determined")
    light = replace(LIGHT, std={"albedo": [0.01, 0.0025]}, gain={"albedo": 4.0}, worst=(0.1, 0.025))
    text = words(replace(CHECK, parameters={"albedo": albedo}, light=light, levels={}))
    assert "vase: lambert; errors are those of the least known channel" in text
    assert "albedo 0.5, 0.1 ± 0.01 10% determined" in text
    assert "albedo ± 0.01 ± 0.0025 4 ×" in text
