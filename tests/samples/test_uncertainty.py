"""Standard uncertainties of a calibration."""

from __future__ import annotations

import math
import pickle
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from matest.samples.uncertainty import NAMES, PARTS, Family, Uncertainty, families, labelled, read
from tests.captures import refusal


def test_every_name_has_a_field_and_every_number_of_it_a_unit_and_a_limit() -> None:
    assert {field.name for field in fields(Uncertainty)} == {*NAMES}
    for family in NAMES.values():
        assert len(family.unit.split(",")) == len(family.most)


def test_what_is_not_stated_is_none() -> None:
    assert Uncertainty().stated == {}
    assert Uncertainty(intensity=0.02).direction is None
    assert Uncertainty(intensity=0.02, pose=(0.5, 0.01)).stated == {"intensity": 0.02, "pose": (0.5, 0.01)}


def test_numbers_of_files_and_command_lines_become_floats_and_pairs() -> None:
    uncertainty = Uncertainty.of({"pose": [1, 0.01], "radius": 1})
    assert uncertainty == Uncertainty(pose=(1.0, 0.01), radius=1.0)
    assert isinstance(uncertainty.radius, float)
    assert pickle.loads(pickle.dumps(uncertainty)) == uncertainty


def test_numbers_of_arrays_are_numbers() -> None:
    assert Uncertainty(direction=np.float32(0.25) / 2).direction == 0.125


@pytest.mark.parametrize(("name", "family"), NAMES.items())
def test_the_example_of_every_family_may_be_stated(name: str, family: Family) -> None:
    assert Uncertainty.of({name: read(name, family.example)}).stated


@pytest.mark.parametrize(
    ("name", "text", "numbers"),
    [
        ("direction", "0.01", [0.01]),
        ("direction", "1deg", [math.radians(1)]),
        ("rotation", "1.5 °", [math.radians(1.5)]),
        ("intensity", "3%", [0.03]),
        ("black", "0.2 %", [0.002]),
        ("pose", "0.5, 1deg", [0.5, math.radians(1)]),
    ],
)
def test_a_text_may_state_degrees_and_per_cent(name: str, text: str, numbers: list[float]) -> None:
    assert read(name, text) == pytest.approx(numbers, rel=1e-15)


@pytest.mark.parametrize(
    ("name", "text"),
    [("direction", "3%"), ("intensity", "1deg"), ("radius", "2%"), ("pose", "1deg,0.5"), ("blur", "wide")],
)
def test_a_unit_of_another_quantity_is_refused(name: str, text: str) -> None:
    assert refusal(lambda: read(name, text)).endswith(f", as {NAMES[name].example}; got '{text}'.")


def test_what_is_stated_later_comes_first() -> None:
    capture = Uncertainty(direction=0.01, pose=(0.5, 0.01))
    assert capture.merged(Uncertainty(direction=0.02, blur=1.0)) == Uncertainty(
        direction=0.02, pose=(0.5, 0.01), blur=1.0
    )
    assert capture.merged(Uncertainty()) == capture


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"directoin": 0.01}, "unknown uncertainty 'directoin'; did you mean 'direction'?"),
        ({"direction": 0.0}, "direction is a standard deviation (rad) and must be positive; got 0."),
        ({"direction": -0.1}, "must be positive; got -0.1."),
        ({"intensity": float("nan")}, "must be positive; got nan."),
        ({"intensity": float("inf")}, "must be positive; got inf."),
        ({"shift": 1.0}, "unknown uncertainty 'shift'; state pose=0.5,0.01."),
        ({"albedo_field": 0.1}, "unknown uncertainty 'albedo_field'; state albedo=0.01."),
        ({3: 0.1}, "unknown uncertainty '3'; known are direction,"),
        (["direction"], "what is stated are numbers by name, as {'direction': 0.01}; got ['direction']."),
        ({"direction": 0.5}, "direction (rad) must be at most 0.2; got 0.5. 0.5° is 0.00873 rad."),
        ({"direction": 1}, "direction (rad) must be at most 0.2; got 1. 1° is 0.0175 rad."),
        ({"direction": 57}, "at most 0.2; got 57. 57° is 0.995 rad, which is too much as well."),
        ({"ambient": 3}, "ambient (relative) must be at most 1; got 3. 3 % is 0.03."),
        ({"black": 60}, "black (fraction of full scale) must be at most 0.5; got 60."),
        ({"pose": 0.5}, "pose must be 2 numbers (pixels,rad), as 0.5,0.01; got 0.5."),
        ({"pose": [0.5, 2]}, "pose (rad) must be at most 0.2; got 2. 2° is 0.0349 rad."),
        ({"pose": (None, 0.1)}, "pose must be 2 numbers (pixels,rad), as 0.5,0.01; got (None, 0.1)."),
        ({"direction": [0.01, 0.02]}, "direction must be one number (rad), as 0.01; got [0.01, 0.02]."),
        ({"blur": [1, 2]}, "blur must be one number (pixels), as 0.5; got [1, 2]."),
        ({"blur": "1.5"}, "blur must be one number (pixels), as 0.5; got '1.5'."),
        ({"blur": True}, "blur must be one number (pixels), as 0.5; got True."),
    ],
)
def test_what_is_no_standard_deviation_is_refused_with_what_is_meant(values: Any, words: str) -> None:
    assert words in refusal(lambda: Uncertainty.of(values))


def test_all_is_every_family_and_each_counts_once() -> None:
    assert families(["all"]) == tuple(NAMES)
    assert families(["blur", "black", "blur"]) == ("blur", "black")
    assert families([]) == ()
    assert "did you mean 'rotation'?" in refusal(lambda: families(["rotatoin"]))
    assert "did you mean 'rotation'?" in refusal(lambda: families(["all", "rotatoin"]))


def test_names_of_errors_are_several_or_one_text() -> None:
    assert families("direction, blur,") == families(["direction", "blur"]) == ("direction", "blur")
    assert families("all") == tuple(NAMES)


@pytest.mark.parametrize("names", ["", " , ", [""]])
def test_a_text_that_names_no_errors_is_refused(names: Any) -> None:
    expected = "it names no errors; name some, as direction,intensity, or leave it out."
    assert refusal(lambda: families(names)) == expected


@pytest.mark.parametrize("names", [None, 3, [3], [None]])
def test_what_is_no_name_is_refused(names: Any) -> None:
    expected = f"names of errors are expected, as 'direction,intensity'; got {names!r}."
    assert refusal(lambda: families(names)) == expected


def test_what_results_call_errors_are_names_too() -> None:
    for name, parts in PARTS.items():
        for part in parts:
            assert families([part]) == (part,)
            assert labelled(part) == f"{part} ({name})"
    assert labelled("direction") == "direction"
