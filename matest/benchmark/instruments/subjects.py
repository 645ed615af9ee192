"""Captures in memory that matest and its peers are given, with their truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from matest.benchmark.instruments.glossy import Glossy
from matest.benchmark.instruments.photographs import MATERIALS, lights
from matest.benchmark.instruments.simulated import CLEAN, IRRADIANCE, Draw, sphere
from matest.benchmark.instruments.task import Task, Values
from matest.benchmark.rivals.hand_written import Model, levenberg_marquardt
from matest.benchmark.rivals.mitsuba_tutorial import Photographs
from matest.brdf import Brdf, model
from matest.capture import Capture
from matest.estimation.options import Options
from matest.estimation.specification import specify
from matest.estimators import Problem, accumulate
from matest.estimators.covariance import fisher
from matest.identifiability.forecast import unknowns_at
from matest.photographs.noise import Noise
from matest.scene import DirectionalLight, Points, Scene, Surface
from matest.shading import render_image, shade

IMAGES = 12
GLOSSY = "cook-torrance(masking=smith)"
# Radius of the sphere as a share of the image.
RADIUS = 0.46
_NOISE = Noise(0.002, 2e-4)
_EXPOSED = 0.9
# A pedestal: without it dark pixels lose the lower half of their noise, which peers do not know of.
_BLACK = 0.03


@dataclass(frozen=True)
class Subject:
    """A uniform object in 12 photographs.

    Attributes:
        expression: of its model.
        truth: value of every parameter.
        held: names of those that are known.
        draw: the scene and its radiance without noise.
        capture: the photographs, for matest.
        task: the samples with the true noise, for its peers.
    """

    expression: str
    truth: Values
    held: tuple[str, ...]
    draw: Draw
    capture: Capture
    task: Task

    @property
    def fixed(self) -> dict[str, list[float]]:
        """What matest is told of the parameters that are known."""
        return {name: self.truth[name].tolist() for name in self.held}

    def bound(self) -> Values:
        """The Cramér-Rao bound of the standard error of every unknown, from all samples."""
        problem = self.problem()
        truth = unknowns_at(problem, self.truth)
        samples = self.draw.ideal(CLEAN).samples(dtype=torch.float64)
        information = accumulate(problem, truth, samples.tiles(merge=False), truth).information
        std = fisher(information, torch.ones(problem.size, dtype=torch.bool)).std
        return {name: std[place] for name, place in problem.where.items()}

    def optimum(self, prepare: Callable[[Points], Model]) -> Values:
        """The optimum of the likelihood by the solver written by hand, in double precision from the truth."""
        exact = replace(self.task.double(), start=self.task.start.replace(self.truth))
        return levenberg_marquardt(exact, prepare).values[-1]

    def problem(self) -> Problem:
        """What is estimated."""
        scene = self.capture.scene
        options = Options(fix=self.fixed)
        return specify(self.expression, options, channels=scene.channels, relative=False, scene=scene).problem

    def photographs(self) -> Photographs:
        """The capture as whole images, of a sphere by `sphere_of`."""
        surface = self.capture.scene.surface
        size = surface.shape[0]
        everywhere = np.arange(len(surface))
        images = [
            surface.image(np.asarray(self.capture.radiance(k, everywhere), dtype=np.float32))
            for k in range(len(self.capture))
        ]
        return Photographs(np.stack(images), lights(IMAGES), IRRADIANCE, RADIUS * size, float(self.truth["f0"]))


def sphere_of(expression: str, size: int) -> Subject:
    """A sphere of `MATERIALS[expression]`; f0 is known, and peers start in the middle of every domain.

    Images of `GLOSSY` come straight from the equations, by nobody's renderer.
    """
    truth = {name: torch.tensor(value, dtype=torch.float64) for name, value in MATERIALS[expression].items()}
    material = model(expression)[0].replace(truth)
    free = [name for name in material.declared if name in truth and name != "f0"]
    middle = {name: (d.domain.lower + d.domain.upper) / 2 for name in free if (d := material.declared[name])}
    images = None
    if expression == GLOSSY:
        diffuse, specular, slope, f0 = (truth[name].numpy() for name in ("diffuse", "specular", "slope", "f0"))
        glossy = Glossy(diffuse, specular, float(slope), float(f0))
        images = [glossy.photograph(size, RADIUS * size, toward, IRRADIANCE) for toward in lights(IMAGES)]
    held = ["f0"] if "f0" in truth else []
    return subject(material, sphere(size), held, middle, images)


def subject(
    material: Brdf,
    surface: Surface,
    held: Sequence[str],
    start: Mapping[str, float | Tensor],
    images: Sequence[np.ndarray] | None = None,
) -> Subject:
    """Photograph an object.

    Args:
        material: the truth.
        surface: the object.
        held: names of the parameters that are known.
        start: where peers start, for every unknown.
        images: radiance [K, H, W, 3] without noise; None: rendered.
    """
    irradiance = torch.full((3,), IRRADIANCE, dtype=torch.float64)
    lamps = tuple((DirectionalLight(torch.from_numpy(toward), irradiance),) for toward in lights(IMAGES))
    scene = Scene(surface, lamps, torch.zeros(IMAGES, 3, dtype=torch.float64)).with_shadows()
    if images is None:
        images = [render_image(scene, k, material, dtype=torch.float64).numpy() for k in range(IMAGES)]
    radiance = tuple(np.ascontiguousarray(image.reshape(-1, 3)[surface.pixels]) for image in images)
    draw = Draw(1, material, scene, radiance, _NOISE, _BLACK, _EXPOSED)
    capture = draw.photograph(CLEAN)
    samples = capture.samples()
    batch = next(samples.batches(len(samples)))
    # The peers know the true noise.
    weight = batch.weight(shade(material, batch.points))
    task = Task(material.replace(start), tuple(start), batch.points, batch.radiance, weight)
    return Subject(material.expression, material.parameters, tuple(held), draw, capture, task)
