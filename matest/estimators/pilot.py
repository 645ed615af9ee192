"""A stratified subsample: few samples, but every angle that carries information."""

from __future__ import annotations

import numpy as np
import torch

from matest.capture import Batch, Samples
from matest.capture.samples import BLOCKS
from matest.directions import dot
from matest.estimators.walk import walk

# Classes of the angle between half vector and normal, degrees: highlights are small and must not be missed.
_HALF_ANGLES = torch.tensor([2.0, 4.0, 8.0, 16.0, 32.0])
CLASSES = len(_HALF_ANGLES) + 1
_CANDIDATES, _FEW = 8, 16_384  # drawn per sample kept; all of fewer


def pilot(samples: Samples, count: int, seed: int) -> list[Batch]:
    """About `count` samples, spread evenly over images and half angles; one batch per image."""
    quota = max(count // max(len(samples.images), 1), 256)

    def draw(position: int) -> list[Batch]:
        image, index = samples.images[position], samples.indices(position)
        if not len(index):
            return []
        generator = np.random.default_rng((seed, position))
        if len(index) > quota:
            if len(index) > max(_CANDIDATES * quota, _FEW):
                # Drawing without replacement would shuffle the whole image.
                index = index[np.unique(generator.integers(len(index), size=_CANDIDATES * quota))]
            index = _even(samples, image, index, quota, generator)
        batch = samples.at(image, index, cluster=position * BLOCKS)
        samples.capture.release(image)
        return [batch]

    return list(walk([range(len(samples.images))], draw))


def _even(samples: Samples, image: int, index: np.ndarray, quota: int, generator: np.random.Generator) -> np.ndarray:
    """`quota` of the pixels `index`, as evenly over the classes of half angle as they are filled."""
    if len(index) <= quota:
        return index
    classes = half_angles(samples, image, index)
    order = generator.permutation(len(index))
    # Rank within its class: taking the lowest ranks fills all classes alike.
    rank = np.empty(len(index), dtype=np.int64)
    for label in np.unique(classes):
        members = order[classes[order] == label]
        rank[members] = np.arange(len(members))
    return np.sort(index[np.argsort(rank, kind="stable")[:quota]])


def half_angles(samples: Samples, image: int, index: np.ndarray) -> np.ndarray:
    """Class of the smallest half angle among the lights that each pixel faces [n]."""
    scene, chosen = samples.capture.scene, torch.from_numpy(index)
    surface, shadows = scene.surface, scene.shadows[image] if scene.shadows else None
    normals = surface.normals_as(torch.float32)[chosen].detach()
    view = surface.toward_viewer(chosen).detach().float()
    positions = None if surface.positions is None else surface.positions[chosen].detach().float()
    nearest = torch.zeros(len(normals))
    for number, light in enumerate(scene.lights[image]):
        toward, _ = light.to(torch.float32, "cpu").at(positions)
        faces = dot(normals, toward) > 0
        if shadows is not None:
            faces &= torch.from_numpy(~shadows[number][index])
        nearest = torch.maximum(nearest, dot(normals, torch.nn.functional.normalize(toward + view, dim=-1)) * faces)
    return torch.bucketize(-nearest, -torch.cos(torch.deg2rad(_HALF_ANGLES))).numpy()
