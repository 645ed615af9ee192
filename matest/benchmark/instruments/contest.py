"""Captures in memory that matest and its rivals are given, with their truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from torch import Tensor

from matest.benchmark.instruments.bound import cramer_rao, problem_of
from matest.benchmark.instruments.glossy import Glossy
from matest.benchmark.instruments.photographs import (
    FIX,
    IRRADIANCE,
    MATERIALS,
    RADIUS,
    Sensor,
    Subject,
    material_of,
    ring,
    sphere,
    subject,
)
from matest.benchmark.instruments.task import Task, Values
from matest.brdf import Brdf
from matest.capture import Capture
from matest.scene import Surface
from matest.shading import shade

IMAGES = 12
GLOSSY = "cook-torrance(masking=smith)"
# With a pedestal: without it dark pixels lose the lower half of their noise, which rivals do not know of.
_SENSOR = Sensor(black=0.03)


class SphereImages(NamedTuple):
    """Photographs of a sphere in the middle of square images, one distant light each, by an orthographic camera.

    Attributes:
        radiance: [K, S, S, 3].
        toward: unit vectors to the lights [K, 3].
        irradiance: of a surface facing the light.
        radius: of the sphere in pixels.
        f0: reflectance at normal incidence, fixed.
    """

    radiance: np.ndarray
    toward: np.ndarray
    irradiance: float
    radius: float
    f0: float


@dataclass(frozen=True)
class Contest:
    """A uniform object in 12 photographs.

    Attributes:
        subject: what is photographed.
        fix: names of the parameters that nobody has to find.
        capture: the photographs, for matest.
        task: the samples with the true noise, for its rivals.
    """

    subject: Subject
    fix: tuple[str, ...]
    capture: Capture
    task: Task

    @property
    def expression(self) -> str:
        """Of the model."""
        return self.subject.material.expression

    @property
    def truth(self) -> Values:
        """Value of every parameter."""
        return self.subject.material.parameters

    @property
    def fixed(self) -> dict[str, list[float]]:
        """Values of the parameters that nobody has to find."""
        return {name: self.truth[name].tolist() for name in self.fix}

    def bound(self) -> Values:
        """The Cramér-Rao bound of the standard error of every unknown, from all samples."""
        problem = problem_of(self.subject, self.fixed)
        std = cramer_rao(problem, self.subject).std
        return {name: std[place] for name, place in problem.where.items()}

    def images(self) -> SphereImages:
        """The capture as whole images, of a sphere by `sphere_of`."""
        surface = self.capture.scene.surface
        images = [surface.image(self.capture.radiance(k).astype(np.float32)) for k in range(IMAGES)]
        radius = RADIUS * surface.shape[0]
        return SphereImages(np.stack(images), ring(IMAGES), IRRADIANCE, radius, float(self.truth["f0"]))


def sphere_of(expression: str, size: int) -> Contest:
    """A sphere of `MATERIALS[expression]`; f0 is fixed, and rivals start in the middle of every domain.

    Radiance of `GLOSSY` comes straight from the equations, by nobody's renderer.
    """
    material, surface = material_of(expression), sphere(size)
    free = [name for name in material.declared if name in MATERIALS[expression].keys() - FIX[expression]]
    start = {name: (d.domain.lower + d.domain.upper) / 2 for name in free if (d := material.declared[name])}
    radiance = None
    if expression == GLOSSY:
        truth = {name: value.numpy() for name, value in material.parameters.items()}
        glossy = Glossy(truth["diffuse"], truth["specular"], float(truth["slope"]), float(truth["f0"]))
        normals = surface.normals.numpy()
        radiance = [glossy.radiance(normals, toward, IRRADIANCE) for toward in ring(IMAGES)]
    return contest_of(material, surface, list(FIX[expression]), start, radiance)


def contest_of(
    material: Brdf,
    surface: Surface,
    fix: Sequence[str],
    start: Mapping[str, float | Tensor],
    radiance: Sequence[np.ndarray] | None = None,
) -> Contest:
    """Photograph an object.

    Args:
        material: the truth.
        surface: the object.
        fix: names of the parameters that nobody has to find.
        start: where rivals start, for every unknown.
        radiance: noise-free, per image [N, 3]; None: rendered.
    """
    photographed = subject(surface, ring(IMAGES), material, _SENSOR, radiance=radiance)
    capture = photographed.photograph()
    samples = capture.samples()
    batch = next(samples.batches(len(samples)))
    # Rivals know the true noise.
    weight = batch.weight(shade(material, batch.points))
    task = Task(material.replace(start), tuple(start), batch.points, batch.radiance, weight)
    return Contest(photographed, tuple(fix), capture, task)
