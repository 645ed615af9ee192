"""What spoilt pixels do to an estimate, and what a model that does not fit may not call spoilt."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

import matest
from matest.benchmark.instruments.trial import trial
from matest.benchmark.suites.outliers import SPOILT
from matest.brdf import Brdf, CookTorrance, Lambert, LiTorrance, OrenNayar, model
from matest.capture import Capture
from matest.estimation.options import Options
from matest.estimation.result import Estimate
from matest.estimation.specification import specify
from matest.estimators import fit
from matest.estimators.levenberg_marquardt import minimise
from matest.estimators.passes import passes_over
from matest.photographs.noise import Noise
from matest.photographs.photometry import Encoding
from matest.samples.residual_scale import ResidualScale
from tests.captures import changed, directional
from tests.simulated import CAMERA, DIRECTIONS, Studio

STUDIO = Studio(size=64, lights=tuple((directional(towards, 3.0),) for towards in DIRECTIONS))
TRUTH = CookTorrance(diffuse=0.4, specular=0.8, slope=0.2)
VALUES = {"diffuse": 0.4, "specular": 0.8, "slope": 0.2}
FIX = {"f0": 0.04}
ROUGH = OrenNayar(0.7, 0.4)
FIXED: dict[str, dict[str, float]] = {ROUGH.name: {}, TRUTH.name: FIX}


def integers(bits: int, saturation: float, outliers: float, seed: int) -> Capture:
    """Photographs of `bits`, saturated at that fraction of the range, a share of the pixels uniform over it."""
    capture = STUDIO.photograph(TRUTH, seed=seed)
    full = 2**bits - 1
    rng = np.random.default_rng(seed)
    stored = []
    for pixels in capture.photographs.stored:
        values = np.round(full * np.clip(pixels, 0, 1))
        spoilt = rng.random(len(values)) < outliers
        values[spoilt] = rng.integers(0, full + 1, (int(spoilt.sum()), values.shape[1]))
        stored.append(values.astype(np.uint8 if bits == 8 else np.uint16))
    # Rounding adds to the noise that is stated.
    noise = dataclasses.replace(CAMERA, read=float(np.hypot(CAMERA.read, 1 / full / np.sqrt(12))))
    return changed(
        capture, stored=tuple(stored), encoding=Encoding(saturation=saturation), noise=noise, noise_stated=True
    )


@pytest.mark.parametrize(("bits", "saturation", "outliers"), [(16, 0.45, 0.0), (16, 1.0, 0.03), (8, 0.45, 0.02)])
def test_spoilt_pixels_leave_the_estimate_within_its_error_bars(bits: int, saturation: float, outliers: float) -> None:
    scores = []
    for seed in (1, 2, 3):
        found = matest.estimate(integers(bits, saturation, outliers, seed), "cook-torrance", fix=FIX)
        assert found.fit.errors == "fisher"
        # Those above saturation are bounds, and wrong ones.
        assert found.fit.outliers == pytest.approx(outliers, abs=0.4 * outliers + 1e-4)
        assert any("were left out" in warning for warning in found.warnings) == (outliers > 0)
        scores += [
            (found.parameters[name].value - value) / found.parameters[name].std for name, value in VALUES.items()
        ]
    assert np.sqrt(np.mean(np.square(scores))) < 2


@pytest.mark.parametrize("seed", [10, 25])
def test_outliers_that_bend_the_first_guess_do_not_decide_the_last(seed: int) -> None:
    # Seed 10 takes many expansions of the likelihood, 25 starts without the highlight.
    assert trial("cook-torrance", seed, SPOILT, grid=False).worst < 5


@cache
def undisturbed(truth: Brdf) -> tuple[Capture, Estimate]:
    """Photographs without a spoilt pixel, and their estimate."""
    capture = STUDIO.photograph(truth, seed=1)
    return capture, matest.estimate(capture, truth.name, fix=FIXED[truth.name])


@pytest.mark.parametrize("size", [200.0, -1000.0, 1000.0, 1e9, 1e14])
@pytest.mark.parametrize("truth", [ROUGH, TRUTH], ids=lambda truth: truth.name)
def test_one_wild_pixel_moves_nothing(truth: Brdf, size: float) -> None:
    capture, clean = undisturbed(truth)
    # Among the brightest, where it enters the subsample of the search.
    stored = [pixels.copy() for pixels in capture.photographs.stored]
    stored[0][stored[0][:, 0].argsort()[-9]] = size
    found = matest.estimate(changed(capture, stored=tuple(stored)), truth.name, fix=FIXED[truth.name])
    assert_within_standard_errors(clean, found)


@pytest.mark.parametrize("truth", [ROUGH, TRUTH], ids=lambda truth: truth.name)
def test_a_hundredth_of_wild_pixels_moves_nothing_by_a_standard_error(truth: Brdf) -> None:
    capture, clean = undisturbed(truth)
    rng, stored = np.random.default_rng(0), []
    for pixels in capture.photographs.stored:
        wild, spoilt = rng.random(len(pixels)) < 0.01, pixels.copy()
        spoilt[wild] = (10 ** rng.uniform(-3, 6, (int(wild.sum()), 1)) * rng.choice([-1, 1])).astype(np.float32)
        stored.append(spoilt)
    found = matest.estimate(changed(capture, stored=tuple(stored)), truth.name, fix=FIXED[truth.name])
    assert_within_standard_errors(clean, found)


def assert_within_standard_errors(clean: Estimate, found: Estimate) -> None:
    """No parameter moved by more than one, and error bars are what they were."""
    for name, parameter in clean.parameters.items():
        if parameter.status == "determined":
            assert abs(found.parameters[name].value - parameter.value) < parameter.std
            assert found.parameters[name].std == pytest.approx(parameter.std, rel=0.05)


def glossy() -> Capture:
    """Photographs of a body under two GGX lobes, one of them narrow, with strengths of light that are 3 % off."""
    lobes = "cook-torrance(distribution=ggx)"
    parts = [
        Lambert(0.4),
        *(model(lobes)[0].replace({"diffuse": 0.0, "specular": 0.3, "slope": m}) for m in (0.03, 0.1)),
    ]
    strength = 1 + 0.03 * np.random.default_rng(2).standard_normal((len(DIRECTIONS), 1, 1))
    studio = Studio(size=96, noise=Noise(0.002, 0.0002))
    return studio.expose(strength * sum(studio.clean(part) for part in parts), 1)


def test_a_lobe_that_is_too_simple_keeps_its_highlight_from_every_start() -> None:
    samples = glossy().samples()
    problem = specify("cook-torrance", Options(fix=FIX), channels=1, relative=False, scene=samples).problem
    everything = ResidualScale.uniform(1e9)
    slope, ends = problem.where["slope"], []
    best = fit(problem, samples, 0).unknowns
    for start in (0.01, 0.6):
        unknowns = best.clone()
        unknowns[slope] = start
        solution = fit(problem, samples, 0, start=unknowns)
        assert solution.statistics.outliers < 0.001
        ends.append(float(solution.unknowns[slope]))
    assert ends == pytest.approx([float(best[slope])] * 2, rel=1e-3)
    # Least squares, with the noise at its own optimum.
    unknowns = best
    for _ in range(5):
        evaluate = passes_over(problem, samples.tiles(), unknowns, unknowns, everything)
        unknowns = minimise(problem, unknowns, evaluate, passes=60, tolerance=0.01).unknowns
    assert float(best[slope]) == pytest.approx(float(unknowns[slope]), rel=0.2)


def test_a_highlight_that_the_model_lacks_is_told_of() -> None:
    found = matest.estimate(glossy(), "cook-torrance", fix=FIX)
    (said,) = [warning for warning in found.warnings if warning.startswith("Where the half vector is 0°")]
    assert said.endswith("Those values count in full, not as outliers; try another lobe, or a second one.")
    assert not any("were left out" in warning for warning in found.warnings)
    right = matest.estimate(STUDIO.photograph(TRUTH, seed=1), "cook-torrance", fix=FIX)
    assert not any("half vector" in warning for warning in right.warnings)


def test_saturated_highlights_still_tell_their_strength() -> None:
    whole = matest.estimate(integers(16, 1.0, 0.0, 4), "cook-torrance", fix=FIX).parameters["specular"]
    cut = matest.estimate(integers(16, 0.3, 0.0, 4), "cook-torrance", fix=FIX)
    assert cut.skipped["samples"]["saturated"] > 100
    assert abs(cut.parameters["specular"].value - 0.8) < 4 * cut.parameters["specular"].std
    assert whole.std < cut.parameters["specular"].std < 20 * whole.std


def test_a_model_that_misses_everything_says_so() -> None:
    mirror = LiTorrance(k_dd=0.9, f0=0.9, height_rms=0.05, correlation_length=2.0, subsurface="off")
    found = matest.estimate(Studio(size=48, lights=STUDIO.lights).photograph(mirror, seed=1), "lambert")
    assert found.fit.relative_rmse > 0.5
    # What it misses are no outliers.
    assert found.fit.outliers < 0.001
    assert any("misses the images" in warning for warning in found.warnings)


def test_one_photograph_of_something_else_is_named() -> None:
    capture = STUDIO.photograph(TRUTH, seed=1)
    black = [pixels.copy() for pixels in capture.photographs.stored]
    black[3][:] = 0
    spoilt = matest.estimate(changed(capture, stored=tuple(black)), "cook-torrance", fix=FIX)
    assert any(f"{capture.names[3]} is 100 % too dark for its light" in warning for warning in spoilt.warnings)
    # Of three too, where the rest is far from linear.
    three = Studio(size=64, lights=STUDIO.lights[:3]).photograph(OrenNayar(0.7, 0.6), seed=1)
    black = [three.photographs.stored[0], np.zeros_like(three.photographs.stored[1]), three.photographs.stored[2]]
    spoilt = matest.estimate(changed(three, stored=tuple(black)), "oren-nayar")
    assert any(f"{three.names[1]} is 100 % too dark for its light" in warning for warning in spoilt.warnings)
    # A model that fits none of them is not an image's fault, nor is noise that is overstated.
    wrong = matest.estimate(capture, "lambert")
    assert wrong.fit.reduced_chi2 > 1.5
    few = Studio(size=64, lights=STUDIO.lights[-3:]).photograph(OrenNayar(0.6, 0.5), seed=1)
    loud = changed(few, noise=Noise(0.01, 0.002))
    for found in (wrong, matest.estimate(few, "lambert"), matest.estimate(loud, "lambert")):
        assert not any("Without" in warning for warning in found.warnings)
        assert not any(image.stands_out for image in found.images)


def test_ordinary_noise_has_no_outliers() -> None:
    found = matest.estimate(STUDIO.photograph(Lambert(0.5), seed=9), "lambert")
    assert found.fit.outliers < 1e-4
    assert not any("left out" in warning for warning in found.warnings)


def test_a_lobe_that_is_not_there_is_told() -> None:
    found = matest.estimate(Studio(size=32).photograph(Lambert(0.5), 1), "cook-torrance")
    assert found.parameters["slope"].status == "not determined"
    assert any(warning.startswith("No lobe of specular is seen") for warning in found.warnings)
    seen = matest.estimate(Studio(size=32).photograph(CookTorrance(0.3, 0.8, 0.2), 1), "cook-torrance")
    assert not any("No lobe" in warning for warning in seen.warnings)
