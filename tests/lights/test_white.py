"""Strengths of lights from flat white targets whose light is known."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matest.capture.mirrors import load_target
from matest.lights.mirror import Mirror
from matest.lights.position import Position
from matest.lights.white import measure_white
from tests.captures import put_image, refusal
from tests.lights.test_strengths import COUNT, directions, lights_at, relative

NORMAL = np.array([0.15, -0.1, 1.0]) / np.linalg.norm([0.15, -0.1, 1.0])
SIZE = 48


def target(
    folder: Path, vectors: np.ndarray, power: np.ndarray, *, noise: float = 0.002, texture: float = 0.03, seed: int = 0
) -> Mirror:
    """Photographs in 16 bits of a tilted white square with a border that is not the target."""
    rng = np.random.default_rng(seed)
    inside = np.zeros((SIZE, SIZE), bool)
    inside[6:-6, 8:-8] = True
    pattern = np.where(inside, 0.9 * (1 + texture * rng.standard_normal((SIZE, SIZE))), 0.2)
    put_image(folder / "mask.png", (255 * inside).astype(np.uint8))
    for number, (vector, irradiance) in enumerate(zip(vectors, power, strict=True)):
        image = pattern[..., None] * irradiance * max(vector @ NORMAL, 0) / math.pi
        image = image + noise * rng.standard_normal((SIZE, SIZE, len(irradiance)))
        put_image(folder / f"{number:02d}.png", np.round(65535 * image.clip(0, 1)).astype(np.uint16))
    return load_target(folder)


def test_strengths_and_colours_follow_where_the_normal_is_known(tmp_path: Path) -> None:
    generator = np.random.default_rng(2)
    vectors, power = directions(generator), generator.uniform(0.8, 2.4, (COUNT, 3))
    found = measure_white(lights_at(vectors), target(tmp_path, vectors, power), tuple(3 * NORMAL))
    assert np.abs(relative(found.power, power)).max() < 1e-3
    assert found.power.mean(axis=0) / power.mean(axis=0) == pytest.approx(math.pi / power.mean(), rel=1e-3)
    assert found.std.max() < 2e-3
    assert found.normal == pytest.approx(NORMAL)
    assert found.normal_std is None
    assert found.notes == ()


def test_error_bars_hold_errors_of_the_directions_and_of_an_unknown_normal(tmp_path: Path) -> None:
    generator, std, distances, tilts = np.random.default_rng(3), 0.01, [], []
    for trial in range(12):
        folder = tmp_path / str(trial)
        folder.mkdir()
        vectors, power = directions(generator), 2 * np.exp(0.05 * generator.standard_normal((COUNT, 1)))
        stated = vectors + std * generator.standard_normal(vectors.shape)
        stated /= np.linalg.norm(stated, axis=1, keepdims=True)
        found = measure_white(lights_at(stated, std), target(folder, vectors, power, seed=trial))
        assert found.normal is not None
        assert found.normal_std is not None
        distances.append(relative(found.power, power) / found.std)
        tilts.append(np.linalg.norm(found.normal - NORMAL) / found.normal_std / math.sqrt(2))
    assert 0.6 < np.sqrt(np.mean(np.square(distances))) < 1.5
    assert 0.5 < np.sqrt(np.mean(np.square(tilts))) < 1.6


def test_a_target_under_lights_that_are_alike_shows_its_normal(tmp_path: Path) -> None:
    vectors = directions(np.random.default_rng(5))
    found = measure_white(lights_at(vectors), target(tmp_path, vectors, np.full((COUNT, 1), 2.0)))
    assert math.degrees(np.linalg.norm(found.normal - NORMAL)) < 0.1


def test_an_uneven_target_is_said(tmp_path: Path) -> None:
    vectors = directions(np.random.default_rng(2))
    mirror = target(tmp_path, vectors, np.full((COUNT, 1), 1.0), noise=0.05)
    assert "differ by" in measure_white(lights_at(vectors), mirror, (0, 0, 1)).notes[0]


def test_what_cannot_be_measured_is_refused(tmp_path: Path) -> None:
    vectors = directions(np.random.default_rng(2))
    lights, mirror = lights_at(vectors), target(tmp_path, vectors, np.full((COUNT, 1), 2.0))
    few = replace(mirror, files=mirror.files[:4])
    assert "expected 8 photographs of the white target" in refusal(lambda: measure_white(lights, few))
    sentence = refusal(lambda: measure_white(lights_at(vectors[:4]), few))
    assert "4 lights do not tell the normal of the white target from their strengths, 5 would" in sentence
    away = refusal(lambda: measure_white(lights, mirror, (-1.0, 0.0, 0.05)))
    assert "from the normal of the target, which it hardly lights" in away
    near = replace(lights.lights[0], position=Position(np.ones(3), np.eye(3)))
    placed = replace(lights, lights=(near, *lights.lights[1:]))
    assert "measures distant lights" in refusal(lambda: measure_white(placed, mirror))
    bright = target(tmp_path, vectors, np.full((COUNT, 1), 9.0))
    assert "are saturated in no photograph" in refusal(lambda: measure_white(lights, bright))
    dark = target(tmp_path, -vectors, np.full((COUNT, 1), 2.0), noise=0)
    assert "dark where its light should be" in refusal(lambda: measure_white(lights, dark))
