"""Strengths of lights from matte balls whose light is known."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matest.capture.mirrors import load_mirror
from matest.lights.lights import Light, Lights
from matest.lights.mirror import Mirror
from matest.lights.position import Placement, Position
from matest.lights.sphere import MirrorSphere
from matest.lights.strengths import measure
from matest.scene.camera import Camera
from tests.captures import put_image, refusal
from tests.lights.matte_ball import CIRCLE, photograph

COUNT = 8


def directions(generator: np.random.Generator, count: int = COUNT) -> np.ndarray:
    vectors = generator.standard_normal((count, 3))
    vectors[:, 2] = np.abs(vectors[:, 2]) + 0.8
    unit: np.ndarray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def lights_at(vectors: np.ndarray, std: float = 0.0) -> Lights:
    across = [std**2 * (np.eye(3) - np.outer(vector, vector)) for vector in vectors]
    named = enumerate(zip(vectors, across, strict=True))
    return Lights(tuple(Light(f"{k}.png", vector, own, np.zeros((1, 3)), ()) for k, (vector, own) in named))


def matte(folder: Path, images: list[np.ndarray], circle: tuple[float, float, float] = CIRCLE) -> Mirror:
    for number, image in enumerate(images):
        put_image(folder / f"{number:02d}.png", image)
    return load_mirror(folder, [circle])


def relative(power: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Relative errors but for a factor of each channel."""
    logs = np.log(power / truth)
    errors: np.ndarray = logs - logs.mean(axis=0)
    return errors


def test_strengths_and_colours_of_lights_are_those_of_the_photographs(tmp_path: Path) -> None:
    generator = np.random.default_rng(2)
    vectors, power = directions(generator), generator.uniform(1, 3, (COUNT, 3))
    images = [
        photograph(v, p, ambient=0.01, noise=0.002, seed=k) for k, (v, p) in enumerate(zip(vectors, power, strict=True))
    ]
    found = measure(lights_at(vectors), matte(tmp_path, images))
    assert np.abs(relative(found.power, power)).max() < 0.005
    # The approximation behind the photographs has no light between facets: σ comes out a little larger.
    assert found.sigma == pytest.approx(0.3, abs=0.05)
    assert found.misfit < 0.02
    assert found.power.mean() == pytest.approx(math.pi)
    # Channels are compared with each other too: the ball is grey.
    assert found.power.mean(axis=0) / power.mean(axis=0) == pytest.approx(math.pi / power.mean(), rel=0.01)


def test_error_bars_hold_errors_of_directions_circle_and_texture(tmp_path: Path) -> None:
    generator, std, distances = np.random.default_rng(3), 0.015, []
    for trial in range(4):
        folder = tmp_path / str(trial)
        folder.mkdir()
        vectors, power = directions(generator), generator.uniform(1, 3, (COUNT, 1))
        images = [
            photograph(v, p, texture=0.1, noise=0.003, seed=k)
            for k, (v, p) in enumerate(zip(vectors, power, strict=True))
        ]
        stated = vectors + std * generator.standard_normal(vectors.shape)
        stated /= np.linalg.norm(stated, axis=1, keepdims=True)
        x, y, radius = np.array(CIRCLE) + 0.5 * generator.standard_normal(3)
        found = measure(lights_at(stated, std), matte(folder, images, (x, y, radius)))
        distances.append(relative(found.power, power) / found.std)
    assert 0.6 < np.sqrt(np.mean(np.square(distances))) < 1.5


def test_saturated_pixels_and_stains_do_not_count(tmp_path: Path) -> None:
    generator = np.random.default_rng(4)
    vectors, power = directions(generator), np.linspace(2, 10, COUNT)[:, None]
    images = [photograph(v, p) for v, p in zip(vectors, power, strict=True)]
    for image in images[::2]:
        image[40:55, 40:60] //= 3
    assert max(image.max() for image in images) == 65535
    found = measure(lights_at(vectors), matte(tmp_path, images))
    assert np.abs(relative(found.power, power)).max() < 0.02


def test_exposures_are_divided_out(tmp_path: Path) -> None:
    vectors = directions(np.random.default_rng(5), 3)
    images = [photograph(v, np.array([e])) for v, e in zip(vectors, (1.0, 2.0, 4.0), strict=True)]
    subject = replace(matte(tmp_path, images), exposures=(1.0, 2.0, 4.0))
    assert np.abs(relative(measure(lights_at(vectors), subject).power, np.ones((3, 1)))).max() < 0.005


def test_a_glossy_sphere_is_noted(tmp_path: Path) -> None:
    vectors = directions(np.random.default_rng(6))
    # Each photograph under the light of another: nothing fits.
    images = [photograph(v, np.ones(1)) for v in np.roll(vectors, 1, axis=0)]
    (note,) = measure(lights_at(vectors), matte(tmp_path, images)).notes
    assert "differs from a matte one" in note


def test_near_lights_get_intensities(tmp_path: Path) -> None:
    vectors, distances = directions(np.random.default_rng(7), 4), np.array([20.0, 30.0, 40.0, 50.0])
    images = [photograph(v, np.array([2.0])) for v in vectors]
    subject = matte(tmp_path, images)
    camera = Camera(position=(0.0, 0.0, 0.0), target=(0.0, 0.0, -1.0), fov_y=0.02)
    sphere = MirrorSphere.from_circle(CIRCLE, subject.shape, camera)
    # A far camera, so that it sees the ball as the photographs do.
    centre = sphere.centre()
    lights = lights_at(vectors)
    near = tuple(
        replace(light, position=Position(centre + d * v, 1e-8 * np.eye(3)))
        for light, v, d in zip(lights.lights, vectors, distances, strict=True)
    )
    placement = Placement(1.0)
    found = measure(Lights(near), replace(subject, spheres=(sphere,)), placement)
    assert np.abs(relative(found.power, distances[:, None] ** 2)).max() < 0.02
    assert "perspective" in refusal(lambda: measure(Lights(near), subject, placement))


def test_photographs_that_tell_nothing_are_refused(tmp_path: Path) -> None:
    vectors = directions(np.random.default_rng(8), 2)
    subject = matte(tmp_path, [photograph(v, np.ones(1)) for v in vectors])
    assert "expected 1 photographs of the matte sphere" in refusal(lambda: measure(lights_at(vectors[:1]), subject))
    dark = matte(tmp_path, [photograph(vectors[0], np.ones(1)), photograph(vectors[0], np.zeros(1))])
    behind = lights_at(np.array([[0.0, 0.0, -1.0]] * 2))
    assert "00.png: only 0 pixels of the matte sphere are lit" in refusal(lambda: measure(behind, subject))
    assert "01.png: the matte sphere is dark" in refusal(lambda: measure(lights_at(vectors[:1].repeat(2, 0)), dark))
    two = replace(subject, spheres=subject.spheres * 2)
    assert "expected one matte sphere; got 2" in refusal(lambda: measure(lights_at(vectors), two))
