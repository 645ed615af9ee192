"""Mitsuba 3 and Dr.Jit shade what matest shades; without them one sentence says so."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from matest.benchmark.instruments.contest import GLOSSY, Contest, sphere_of
from matest.benchmark.instruments.photographs import IRRADIANCE, ring
from matest.benchmark.instruments.task import distance
from matest.benchmark.rivals import drjit_solver, hand_written, mitsuba_tutorial, renderers
from matest.benchmark.suites import peers
from tests.benchmark.glossy import Glossy

SIZE = 32
# Of the brightest pixel.
SAME = 5e-3


# LLVM older than the processor ends the process that it compiles a shader for: a process of its own tries it out.
TRY_OUT = """
import mitsuba
mitsuba.set_variant("llvm_ad_rgb")
scene = {"type": "scene", "integrator": {"type": "direct"}, "light": {"type": "constant"},
         "camera": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8}},
         "ball": {"type": "sphere", "bsdf": {"type": "roughplastic"}}}
assert mitsuba.render(mitsuba.load_dict(scene), spp=1).numpy().shape == (8, 8, 3)
"""


@pytest.fixture(scope="session")
def llvm() -> None:
    """Skip a test where Mitsuba 3 cannot render."""
    if subprocess.run([sys.executable, "-c", TRY_OUT], capture_output=True, check=False).returncode:
        pytest.skip("needs Mitsuba 3 and an LLVM that knows this processor (Debian: apt-get install libllvm19)")


needs_llvm = pytest.mark.usefixtures("llvm")


@pytest.fixture(scope="module")
def glossy() -> Contest:
    return sphere_of(GLOSSY, SIZE)


def test_photographs_show_what_the_equations_say(glossy: Contest) -> None:
    truth = {name: value.numpy() for name, value in glossy.truth.items()}
    sphere = Glossy(truth["diffuse"], truth["specular"], float(truth["slope"]), float(truth["f0"]))
    normals = glossy.subject.scene.surface.normals.numpy()
    for image, toward in zip(glossy.subject.radiance, ring(12), strict=True):
        np.testing.assert_allclose(image, sphere.radiance(normals, toward, IRRADIANCE), rtol=1e-9)


@needs_llvm
def test_mitsuba_renders_what_the_equations_say(glossy: Contest) -> None:
    surface = glossy.capture.scene.surface
    exact = np.stack([surface.image(image) for image in glossy.subject.radiance])
    scenes = mitsuba_tutorial.Scenes(exact, glossy.truth)
    for number, image in enumerate(exact):
        rendered = np.array(scenes.render(number))
        assert np.abs(rendered - image).max() < SAME * image.max()
        assert np.array_equal(rendered > 0, image > 0)


@needs_llvm
def test_tutorial_comes_closer(glossy: Contest) -> None:
    near = {name: glossy.truth[name] * 1.2 for name in ("diffuse", "specular", "slope")}
    trace = mitsuba_tutorial.tutorial(glossy.images()[:2], near, 0.01, lambda trace: len(trace.values) == 12)
    only = {"diffuse": glossy.truth["diffuse"]}
    assert distance(trace.values[-1], only) < 0.5 * distance(near, only)


@needs_llvm
def test_drjit_solver_reaches_the_optimum_from_the_middle_of_the_domain(glossy: Contest) -> None:
    optimum = hand_written.optimum(glossy.task, glossy.truth)
    trace, prepared = drjit_solver.levenberg_marquardt(glossy.task)
    assert distance(trace.values[-1], optimum) < 1e-3
    assert 0 < prepared < trace.seconds[0]


def test_without_llvm_or_mitsuba_one_sentence_says_what_is_missing(
    glossy: Contest, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nonexistent")
    race = renderers.race(glossy, glossy.truth, 1.0)
    assert race == {"mitsuba": [], "dr.jit": []}
    for peer, runs in race.items():
        found = list(peers.figures(GLOSSY, peer, 1.0, runs, glossy.truth, renderers.MISSING))
        assert [(record.value, record.note) for record in found] == 2 * [(None, renderers.MISSING)]
    assert 'pip install "matest-brdf[peers]"' in renderers.MISSING


def test_photographs_are_what_the_capture_holds(glossy: Contest) -> None:
    images = glossy.images()
    assert images.shape == (12, SIZE, SIZE, 3)
    exact = glossy.capture.scene.surface.image(glossy.subject.radiance[0])
    # Read noise is 0.002 of full scale, which is little above the brightest pixel.
    assert np.abs(images[0] - exact).max() < 0.05 * exact.max()
    for lights, toward in zip(glossy.subject.scene.lights, ring(12), strict=True):
        np.testing.assert_array_equal(lights[0].direction, toward)
