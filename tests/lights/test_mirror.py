from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matest.lights.mirror import Mirror
from matest.lights.sphere import MirrorSphere
from matest.photographs.photometry import Encoding
from matest.scene.camera import Camera
from tests.captures import put_image, refusal
from tests.lights.mirror_ball import Ball, Lamp, degrees_between, unit

CIRCLES = ((70.0, 80.0, 55.0), (230.0, 75.0, 60.0))


def mirror(folder: Path, names: list[str], saturation: float | tuple[float, ...] | None = 0.98) -> Mirror:
    spheres = tuple(MirrorSphere.from_circle(circle, (160, 300), Camera()) for circle in CIRCLES)
    files = tuple(folder / name for name in names)
    return Mirror(folder, files, tuple(names), spheres, None, Encoding(saturation=saturation), (160, 300))


def test_brightness_is_a_share_of_what_each_channel_clips_at(tmp_path: Path) -> None:
    image = np.zeros((160, 300, 3), np.uint8)
    image[0, 0], image[0, 1] = (255, 255, 255), (128, 255, 64)
    put_image(tmp_path / "a.png", image)
    brightness = mirror(tmp_path, ["a.png"], (0.5, 1.0, 1.0)).brightness(0)
    assert brightness[0, 0] == 1
    assert brightness[0, 1] == pytest.approx((1 + 1 + 64 / 255) / 3, rel=1e-5)


def test_two_spheres_in_one_photograph_see_the_same_light(tmp_path: Path) -> None:
    lights = [unit(0.4, 0.1, 0.8), unit(-0.3, 0.5, 0.8)]
    for name, light in zip("ab", lights, strict=True):
        lamp = [Lamp(light, math.radians(4), 0.9)]
        images = [Ball(300, circle).photograph(lamp)[:160] for circle in CIRCLES]
        put_image(tmp_path / f"{name}.png", np.round(255 * np.maximum(*images)).astype(np.uint8))
    heard: list[tuple[int | None, int | None]] = []
    seen = mirror(tmp_path, ["a.png", "b.png"]).sightings(lambda _, done, total: heard.append((done, total)))
    for sightings in seen:
        for sighting, light in zip(sightings, lights, strict=True):
            assert degrees_between(sighting.ray.direction, np.array(light)) < 0.2
    assert heard == [(1, 2), (2, 2)]


def test_a_photograph_of_another_size_is_refused(tmp_path: Path) -> None:
    put_image(tmp_path / "a.png", np.zeros((160, 300), np.uint8))
    put_image(tmp_path / "b.png", np.zeros((160, 200), np.uint8))
    message = refusal(lambda: mirror(tmp_path, ["a.png", "b.png"]).brightness(1))
    assert message.startswith(f"{tmp_path / 'b.png'}: expected the size of a.png, 160×300; got 160×200")


def test_radiance_that_no_sensor_clips_counts_as_it_is(tmp_path: Path) -> None:
    """A window brighter than 1, and a lamp a hundred times as bright."""
    window, light = Lamp(unit(-0.5, -0.4, 0.8), math.radians(10), 4.0), unit(0.4, 0.1, 0.8)
    scaled = [Lamp(window.direction, window.half_angle, window.radiance / 400), Lamp(light, math.radians(4), 1.0)]
    image = 400 * Ball(300, CIRCLES[0]).photograph(scaled, background=0.0)[:160]
    np.save(tmp_path / "a.npy", image.astype(np.float32))
    subject = mirror(tmp_path, ["a.npy"], saturation=None)
    sighting = replace(subject, spheres=subject.spheres[:1]).sightings()[0][0]
    assert degrees_between(sighting.ray.direction, np.array(light)) < 0.1
    assert sighting.saturated == 0
