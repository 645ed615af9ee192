"""A check as the terminal shows it."""

from __future__ import annotations

import math
from dataclasses import replace
from io import StringIO

from rich.console import Console

from matest.identifiability import CalibrationError, CalibrationLimit, Check, LightAdvice, Prediction
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
        "albedo": Prediction([0.5, 0.4], [0.02, 0.04], 0.1, (0.05, None), "1", "determined", noise_std=[0.02, 0.04]),
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
    calibration={},
    limits=[],
    understood={},
)
RADIUS = CalibrationError(0.5, True, "px", "of the outline", {"a.albedo": [0.02, 0.04]}, {"a.albedo": 0.1})
DIRECTION = CalibrationError(math.radians(1), False, "rad", "of lights", {"a.albedo": [1e-6, 0.0]}, {"a.albedo": 2e-6})


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
    albedo = Prediction([0.5, 0.1], [0.02, 0.01], 0.1, None, "1", "determined", noise_std=[0.02, 0.01])
    light = replace(LIGHT, std={"albedo": [0.01, 0.0025]}, gain={"albedo": 4.0}, worst=(0.1, 0.025))
    text = words(replace(CHECK, parameters={"albedo": albedo}, light=light, levels={}))
    assert "vase: lambert; errors are those of the least known channel" in text
    assert "albedo 0.5, 0.1 ± 0.01 10% determined" in text
    assert "albedo ± 0.01 ± 0.0025 4 ×" in text


def test_what_errors_of_the_calibration_do_is_a_table_and_the_first_matters_most() -> None:
    text = words(replace(CHECK, calibration={"radius": RADIUS, "direction": DIRECTION}))
    assert "What errors of the calibration would do error of size albedo" in text
    assert "radius 0.5 px * 10% direction 1° - radius matters most: 0.5 px moves a.albedo by 10%." in text
    assert "* as stated; the predicted errors hold it." in text
    supposed = words(replace(CHECK, calibration={"radius": replace(RADIUS, stated=False)}))
    assert "as stated" not in supposed
    assert "errors of the calibration" not in words(CHECK)


def test_sizes_in_the_table_are_those_that_people_state() -> None:
    sizes = {"blur": (0.25, "px²", "0.5 px"), "intensity": (0.01, "1", "1%"), "rotation": (0.02, "rad", "1.1°")}
    errors = {name: replace(RADIUS, size=size, unit=unit) for name, (size, unit, _) in sizes.items()}
    text = words(replace(CHECK, calibration=errors))
    for name, (_, _, shown) in sizes.items():
        assert f"{name} {shown} *" in text


def test_a_limit_is_one_sentence_with_what_a_better_calibration_would_bring() -> None:
    limit = CalibrationLimit("sigma", "radius", 0.021, 0.019, 0.5, 0.2, 0.0117, "px")
    text = words(replace(CHECK, limits=[limit]))
    assert "sigma ± 2.1%, of which 1.9% from radius (0.5 px): known to 0.2 px, ± 1.2%." in text


def test_beside_stated_errors_the_light_is_judged_by_the_noise() -> None:
    albedo = Prediction([0.5, 0.1], [0.2, 0.1], 1.0, None, "1", "determined", noise_std=[0.02, 0.01])
    light = replace(LIGHT, std={"albedo": [0.01, 0.0025]}, gain={"albedo": 4.0}, worst=(0.1, 0.025))
    text = words(replace(CHECK, parameters={"albedo": albedo}, light=light, calibration={"radius": RADIUS}))
    assert "Its errors are those of the noise alone: parameter error now with it smaller by" in text
    assert "albedo ± 0.01 ± 0.0025 4 ×" in text


def test_the_widest_table_fits_eighty_columns() -> None:
    names = [f"li-torrance.parameter{number}" for number in range(8)]
    error = replace(RADIUS, relative={name: 123.4 / (k + 1) for k, name in enumerate(names)})
    console = Console(file=StringIO(), width=80, highlight=False)
    console.print(check_report(replace(CHECK, calibration={"albedo_field": error})))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert max(len(line) for line in text.splitlines()) <= 80
    assert "3 more parameters: --json." in text
    assert "albedo_field" in text
    assert "…" not in text
