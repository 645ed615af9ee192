"""Captures in memory that matest and its rivals are given, with their truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from matest.benchmark.instruments.photographs import (
    FIX,
    MATERIALS,
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

# Photographs of every contest.
IMAGES = 12
# Expression of the model that renderers have too.
GLOSSY = "cook-torrance(masking=smith)"
# With a pedestal: without it, dark pixels lose the lower half of their noise, which rivals do not know of.
_SENSOR = Sensor(black=0.03)


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
        return self.subject.material.expression

    @property
    def truth(self) -> Values:
        return self.subject.material.parameters

    @property
    def fixed(self) -> dict[str, list[float]]:
        """Values of the parameters that nobody has to find."""
        return {name: self.truth[name].tolist() for name in self.fix}

    def bound(self) -> Values:
        """The Cramér-Rao bound of the standard error of every unknown, from all samples."""
        problem = self.subject.problem(self.fixed)
        std = self.subject.cramer_rao(problem).std
        return {name: std[place] for name, place in problem.where.items()}

    def images(self) -> np.ndarray:
        """The photographs as whole images of radiance [K, S, S, 3]."""
        surface = self.subject.scene.surface
        return np.stack([surface.image(self.capture.radiance(k).astype(np.float32)) for k in range(IMAGES)])


def sphere_of(expression: str, size: int) -> Contest:
    """A sphere of `MATERIALS[expression]`; f0 is fixed, and rivals start in the middle of every domain."""
    material = material_of(expression)
    domains = {name: material.declared[name].domain for name in MATERIALS[expression] if name not in FIX[expression]}
    start = {name: (domain.lower + domain.upper) / 2 for name, domain in domains.items()}
    return contest_of(material, sphere(size), list(FIX[expression]), start)


def contest_of(material: Brdf, surface: Surface, fix: Sequence[str], start: Mapping[str, float | Tensor]) -> Contest:
    """Photograph an object; rivals start at `start`, and nobody has to find the parameters that `fix` names."""
    photographed = subject(surface, ring(IMAGES), material, _SENSOR)
    capture = photographed.photograph()
    samples = capture.samples()
    batch = next(samples.batches(len(samples)))
    # Rivals know the true noise.
    weight = batch.weight(shade(material, batch.points))
    task = Task(material.replace(start), tuple(start), batch.points, batch.radiance, weight)
    return Contest(photographed, tuple(fix), capture, task)
