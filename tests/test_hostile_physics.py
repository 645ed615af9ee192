"""Captures at the limits of physics: a true answer, an honest "not determined", or one sentence."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

import matest
from matest.errors import InputError
from matest.report.folder import write_result

SIDE, ALBEDO, IRRADIANCE, NOISE = 16, 0.5, 3.0, 0.002
Images = list[np.ndarray]


def normals() -> np.ndarray:
    """Of a sphere [H, W, 3], 0 outside."""
    rows, columns = (np.indices((SIDE, SIDE)) + 0.5 - SIDE / 2) / (0.45 * SIDE)
    height = 1 - rows**2 - columns**2
    return np.dstack([columns, -rows, np.sqrt(height.clip(0))]) * (height > 0)[..., None]


def lights(count: int = 6) -> np.ndarray:
    towards = np.random.default_rng(1).normal(size=(count, 3))
    towards[:, 2] = np.abs(towards[:, 2]) + 1
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)


def photographs(facing: np.ndarray, towards: np.ndarray) -> Images:
    """Grey and Lambertian, with noise."""
    rng = np.random.default_rng(2)
    shades = [ALBEDO / math.pi * IRRADIANCE * (facing @ light).clip(0) for light in towards]
    return [(shade + rng.normal(0, NOISE, shade.shape)).astype(np.float32)[..., None] for shade in shades]


def save(folder: Path, images: Images, towards: np.ndarray, facing: np.ndarray, irradiance: float = IRRADIANCE) -> Path:
    np.save(folder / "normals.npy", facing.astype(np.float32))
    tables: dict[str, Any] = {"geometry": {"normals": "normals.npy"}, "image": []}
    if images[0].dtype.kind == "u":
        tables["encoding"] = {"transfer": "linear"}
    for number, (image, light) in enumerate(zip(images, towards, strict=True)):
        np.save(folder / f"{number}.npy", image)
        lit = {"direction": light.tolist(), "irradiance": irradiance}
        tables["image"].append({"file": f"{number}.npy", "lights": [lit]})
    (folder / "capture.toml").write_text(tomli_w.dumps(tables), "utf-8")
    return folder


def alike(value: float, dtype: type = np.uint8) -> Images:
    return [np.full((SIDE, SIDE, 1), value, dtype)] * 6


def scaled(factor: float) -> Images:
    return [(factor * image).astype(np.float32) for image in photographs(normals(), lights())]


def turned_at_random() -> np.ndarray:
    towards = np.abs(np.random.default_rng(3).normal(size=(SIDE, SIDE, 3)))
    return towards / np.linalg.norm(towards, axis=2, keepdims=True) * normals().any(axis=2, keepdims=True)


def island() -> np.ndarray:
    facing = normals()
    facing[5:8, 5:8] = math.nan
    return facing


def strip(shape: tuple[int, int]) -> Callable[[Path], Path]:
    facing = np.broadcast_to(np.array([0.0, 0.0, 1.0]), (*shape, 3))
    return lambda folder: save(folder, photographs(facing, lights(3)), lights(3), facing)


SPHERE = normals()
GOOD = photographs(SPHERE, lights())
# Captures, and whether the true albedo must come out, may not, or nothing of the kind is there.
CAPTURES: dict[str, tuple[Callable[[Path], Path], str]] = {
    "black": (lambda folder: save(folder, alike(0), lights(), SPHERE), "refused"),
    "white": (lambda folder: save(folder, alike(255), lights(), SPHERE), "refused"),
    "black floats": (lambda folder: save(folder, alike(0, np.float32), lights(), SPHERE), "refused"),
    "white floats": (lambda folder: save(folder, alike(1, np.float32), lights(), SPHERE), "other"),
    "constant": (lambda folder: save(folder, alike(128), lights(), SPHERE), "other"),
    "negative": (lambda folder: save(folder, scaled(-1), lights(), SPHERE), "refused"),
    "one pixel": (
        lambda folder: save(folder, [image[8:9, 8:9] for image in GOOD], lights(), SPHERE[8:9, 8:9]), "true",
    ),
    "one image": (lambda folder: save(folder, GOOD[:1], lights()[:1], SPHERE), "true"),
    "lights below": (lambda folder: save(folder, GOOD, lights() * (1, 1, -1), SPHERE), "refused"),
    "one light six times": (lambda folder: save(folder, GOOD[:1] * 6, lights()[[0] * 6], SPHERE), "true"),
    "images 1e-8": (lambda folder: save(folder, scaled(1e-8), lights(), SPHERE), "other"),
    "images 1e8": (lambda folder: save(folder, scaled(1e8), lights(), SPHERE), "unknown"),
    "both 1e-8": (lambda folder: save(folder, scaled(1e-8), lights(), SPHERE, 1e-8 * IRRADIANCE), "true"),
    "both 1e8": (lambda folder: save(folder, scaled(1e8), lights(), SPHERE, 1e8 * IRRADIANCE), "true"),
    "random normals": (lambda folder: save(folder, GOOD, lights(), turned_at_random()), "doubted"),
    "shuffled": (lambda folder: save(folder, GOOD[3:] + GOOD[:3], lights(), SPHERE), "doubted"),
    "island of NaN": (lambda folder: save(folder, GOOD, lights(), island()), "refused"),
    "wide": (strip((1, 65535)), "true"),
    "tall": (strip((65535, 1)), "true"),
}  # fmt: skip
OPTIONS: dict[str, dict[str, Any]] = {
    "lambert": {"model": "lambert"},
    "oren-nayar": {"model": "oren-nayar"},
    "cook-torrance": {"model": "cook-torrance"},
    "auto": {"model": "auto"},
    "maps": {"model": "lambert", "maps": ("albedo",)},
    "refine auto": {"model": "oren-nayar", "refine": ("auto",)},
    "refine all": {"model": "auto", "refine": ("all",)},
}
# Captures that have other reasons to end badly for each of the options.
DELICATE = ("black", "white", "constant")


def outcome(capture: Path, options: dict[str, Any], out: Path) -> matest.Estimate | str:
    """The estimate, whose result is written, or the sentence that refuses it."""
    try:
        loaded = matest.load_capture(capture)
        estimate = matest.estimate(loaded, **options)
        write_result(estimate, loaded, out)
    except InputError as error:
        sentence = str(error)
    else:
        sentence = ""
    if sentence:
        assert capture.name in sentence
        assert "\n" not in sentence
        return sentence
    # NaN and infinity are no JSON.
    json.loads((out / "result.json").read_text("utf-8"), parse_constant=pytest.fail)
    assert list(not_finite(estimate.to_dict())) == []
    return estimate


def not_finite(content: Any, place: str = "") -> Iterator[str]:
    if isinstance(content, dict | list | tuple):
        for key, value in content.items() if isinstance(content, dict) else enumerate(content):
            yield from not_finite(value, f"{place}.{key}")
    elif isinstance(content, float) and not math.isfinite(content):
        yield place


@pytest.mark.parametrize("name", CAPTURES)
def test_lambert_gives_the_truth_or_says_that_something_is_wrong(tmp_path: Path, name: str) -> None:
    make, expected = CAPTURES[name]
    answer = outcome(make(tmp_path), OPTIONS["lambert"], tmp_path / "out")
    assert isinstance(answer, str) == (expected == "refused")
    if isinstance(answer, str):
        return
    albedo = answer.parameters["albedo"]
    if expected == "true":
        assert abs(np.mean(albedo.value) - ALBEDO) < max(5 * np.mean(albedo.std), 0.01 * ALBEDO)
    elif expected == "unknown":
        assert albedo.status == "not determined"
    else:
        assert answer.warnings
    if expected == "doubted":
        assert answer.fit.reduced_chi2 > 100 or albedo.status == "not determined"


@pytest.mark.parametrize("options", [name for name in OPTIONS if name != "lambert"])
@pytest.mark.parametrize("name", DELICATE)
def test_no_model_and_no_option_ends_without_an_answer(tmp_path: Path, name: str, options: str) -> None:
    outcome(CAPTURES[name][0](tmp_path), OPTIONS[options], tmp_path / "out")
