"""Standard uncertainties of a calibration."""

from __future__ import annotations

import pickle
from dataclasses import fields
from typing import Any

import pytest

from matest.samples.uncertainty import NAMES, Uncertainty, families
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
        ({"direction": 1}, "direction (rad) must be at most 0.5; got 1. 1° is 0.0175 rad."),
        ({"ambient": 3}, "ambient (relative) must be at most 1; got 3. 3 % is 0.03."),
        ({"black": 60}, "black (fraction of full scale) must be at most 0.5; got 60."),
        ({"pose": 0.5}, "pose must be 2 numbers (pixels,rad); got 0.5."),
        ({"pose": [0.5, 2]}, "pose (rad) must be at most 0.5; got 2. 2° is 0.0349 rad."),
        ({"blur": [1, 2]}, "blur must be one number (pixels); got [1, 2]."),
        ({"blur": "wide"}, "blur must be one number (pixels); got 'wide'."),
        ({"blur": True}, "blur must be one number (pixels); got True."),
    ],
)
def test_what_is_no_standard_deviation_is_refused_with_what_is_meant(values: dict[str, Any], words: str) -> None:
    assert words in refusal(lambda: Uncertainty.of(values))


def test_all_is_every_family_and_each_counts_once() -> None:
    assert families(["all"]) == tuple(NAMES)
    assert families(["blur", "black", "blur"]) == ("blur", "black")
    assert families([]) == ()
    assert "did you mean 'rotation'?" in refusal(lambda: families(["rotatoin"]))
