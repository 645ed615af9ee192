"""What an estimate says of Li and Torrance's rough surfaces: ratios of lengths, and what lights and camera give."""

from __future__ import annotations

import dataclasses

import pytest
import torch

import matest
from matest.brdf import Brdf, model
from matest.capture import Capture
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.photographs.noise import Noise
from tests.captures import changed, directional
from tests.simulated import CAMERA, DIRECTIONS, Studio

STUDIO = Studio(size=48, lights=tuple((directional(towards, 3.0, 3.0, 3.0),) for towards in DIRECTIONS))
# The model is slow: as many pixels as show its lobes, with half of the usual noise.
SMALL = dataclasses.replace(STUDIO, size=24, noise=Noise(CAMERA.read / 2, CAMERA.gain / 4))
WAVELENGTHS = [0.61, 0.55, 0.46]
MIRROR = "li-torrance(coherent=on,energy=he)"


def material(expression: str, **values: object) -> Brdf:
    tensors = {name: torch.as_tensor(value, dtype=torch.float64) for name, value in values.items()}
    return model(expression)[0].replace(tensors)


def lit_by(capture: Capture, solid_angle: float | None, wavelength: list[float] | None = None) -> Capture:
    lights = tuple(tuple(dataclasses.replace(light, solid_angle=solid_angle) for light in image)
                   for image in capture.scene.lights)  # fmt: skip
    known = None if wavelength is None else torch.tensor(wavelength, dtype=torch.float64)
    return changed(capture, scene=dataclasses.replace(capture.scene, lights=lights, wavelength=known))


@pytest.fixture(scope="module")
def paper() -> matest.Estimate:
    brdf = material("li-torrance", k_dd=[0.5, 0.4, 0.3], k_uds=[0.4, 0.3, 0.2], height_rms=0.5, correlation_length=2.9)
    return matest.estimate(STUDIO.photograph(brdf, seed=3), "li-torrance")


def test_without_coherent_light_only_the_ratio_of_the_lengths_is_reported(paper: matest.Estimate) -> None:
    ratio = paper.parameters["slope_ratio"]
    assert ratio.status == "determined"
    assert abs(ratio.value - 0.5 / 2.9) < 4 * ratio.std
    assert ratio.std < 0.01 * ratio.value
    assert ratio.interval95[0] < ratio.value < ratio.interval95[1]
    for length in ("height_rms", "correlation_length"):
        found = paper.parameters[length]
        assert (found.value, found.std, found.status) == (None, None, "not determined")
    assert not any("height_rms" in warning or "correlation_length" in warning for warning in paper.warnings)


def test_the_ratio_stands_for_the_length_in_the_correlations(paper: matest.Estimate) -> None:
    assert "slope_ratio" in paper.labels
    assert "correlation_length" not in paper.labels
    place = {label: position for position, label in enumerate(paper.labels)}
    # A wider lobe of the same peak needs more light: strength grows with the slope.
    assert paper.correlation[place["slope_ratio"]][place["k_dd[0]"]] > 0
    assert paper.correlation[place["slope_ratio"]][place["slope_ratio"]] == pytest.approx(1)


NINE = Studio(
    size=64,
    lights=tuple((directional(towards, 3.0),) for towards in (
        (0.0, 0.0, 1.0), (0.8, 0.0, 0.6), (-0.8, 0.0, 0.6), (0.0, 0.8, 0.6), (0.0, -0.8, 0.6),
        (0.68, 0.68, 0.27), (-0.68, 0.68, 0.27), (0.68, -0.68, 0.27), (-0.68, -0.68, 0.27),
    )),
    noise=Noise(1e-6, 1e-9),
)  # fmt: skip
TINTED = {"diffuse": 0.1, "specular": 1.0, "slope": 0.3, "f0": 0.04, "f0_mean": 0.04}
FORWARD = {"k_dd": 0.0, "k_uds": 0.4, "k_fs": 5.0, "height_rms": 1.0, "correlation_length": 4.0}


@pytest.mark.parametrize(
    ("expression", "values", "fix", "name"),
    [
        ("li-torrance-forward", {"k_fs": 5.0, "correlation_length": 4.0}, {"height_rms": 1.0}, "correlation_length"),
        ("li-torrance(forward=on)", FORWARD, {"height_rms": 1.0, "k_dd": 0.0}, "correlation_length"),
        ("cook-torrance(fresnel=colour-shift)", TINTED, {"specular": 1.0}, "f0_mean"),
    ],
)
def test_a_lobe_seen_forward_only_determines_what_shapes_it(
    expression: str, values: dict[str, float], fix: dict[str, float], name: str
) -> None:
    capture = NINE.photograph(material(expression, **values), seed=7)
    found = matest.estimate(capture, expression, fix=fix).parameters[name]
    assert found.status == "determined"
    assert found.std < 0.01 * values[name]
    assert abs(found.value - values[name]) < 4 * found.std + 1e-4 * values[name]


def test_a_length_given_by_the_user_makes_the_other_a_number() -> None:
    brdf = material("li-torrance", k_dd=0.5, k_uds=0.4, height_rms=0.5, correlation_length=2.9)
    capture = Studio(size=48).photograph(brdf, seed=5)
    found = matest.estimate(capture, "li-torrance", fix={"height_rms": 0.5}).parameters
    assert abs(found["correlation_length"].value - 2.9) < 4 * found["correlation_length"].std
    assert found["height_rms"].status == "fixed"
    assert found["slope_ratio"].value == pytest.approx(0.5 / found["correlation_length"].value)


def test_coherent_light_determines_both_lengths() -> None:
    """Wavelengths per channel are held: the error bars of the lengths must still be those of one channel each."""
    values = {"k_dd": [0.5, 0.45, 0.4], "k_uds": [0.4, 0.3, 0.2], "height_rms": 0.04, "correlation_length": 2.0}
    brdf = material(MIRROR, **values, wavelength=WAVELENGTHS, solid_angle=0.05)
    scores = []
    for seed in (10, 11, 12, 13):
        capture = lit_by(SMALL.photograph(brdf, seed=seed), 0.05, WAVELENGTHS)
        found = matest.estimate(capture, MIRROR).parameters
        assert found["wavelength"].value == WAVELENGTHS
        assert found["solid_angle"].value == 0.05
        for name in ("height_rms", "correlation_length"):
            assert found[name].status == "determined"
            scores.append((found[name].value - values[name]) / found[name].std)
        ratio = found["slope_ratio"]
        assert ratio.std / ratio.value < found["height_rms"].std / found["height_rms"].value
    assert 0.25 < torch.tensor(scores).square().mean().sqrt() < 2


def test_what_the_capture_does_not_say_is_assumed_and_said_so() -> None:
    capture = Studio(size=24).photograph(material("li-torrance", k_dd=0.5, k_uds=0.4), seed=1)
    found = matest.estimate(capture, "li-torrance(coherent=on)")
    assert any("solid_angle is taken as 0.0005 sr" in warning for warning in found.warnings)
    assert any("wavelength is taken as 0.55 µm" in warning for warning in found.warnings)


@pytest.mark.parametrize("expression", [MIRROR, "li-torrance-coherent", "he-torrance(coherent=on)"])
def test_wavelength_and_solid_angle_come_from_the_capture_and_are_never_estimated(expression: str) -> None:
    dark = Studio(size=24).photograph(material("lambert", albedo=0.3))
    silent = specify(expression, Options(), channels=1, relative=False, scene=dark.scene)
    assert silent.assumed == ("wavelength", "solid_angle")
    assert not {"wavelength", "solid_angle"} & {*silent.problem.free, *silent.default_held}
    said = specify(expression, Options(), channels=1, relative=False, scene=lit_by(dark, 0.05, [0.61]).scene)
    assert said.problem.held["wavelength"].tolist() == [0.61]
    assert float(said.problem.held["solid_angle"]) == 0.05
    assert said.assumed == ()


def test_lights_of_different_size_need_a_word() -> None:
    capture = Studio(size=24).photograph(material("li-torrance", k_dd=0.5, k_uds=0.4), seed=1)
    (first,), *rest = capture.scene.lights
    lights = ((dataclasses.replace(first, solid_angle=0.01),), *rest)
    mixed = changed(capture, scene=dataclasses.replace(capture.scene, lights=lights))
    with pytest.raises(matest.InputError, match="one solid_angle for all lights"):
        matest.estimate(mixed, "li-torrance(coherent=on)")
    assert matest.estimate(mixed, "li-torrance(coherent=on)", fix={"solid_angle": 0.01}).fit.samples > 0
