"""A stratified subsample: few samples, but every angle that carries information."""

from __future__ import annotations

import numpy as np
import torch

from matest.capture import Batch, Samples
from matest.capture.samples import BLOCKS
from matest.shader import gathered_light, lit_directions

# Classes of the angle between half vector and normal, degrees: highlights are small and must not be missed.
_HALF_ANGLES = torch.tensor([2.0, 4.0, 8.0, 16.0, 32.0])
_CANDIDATES = 8  # drawn per sample kept


def pilot(samples: Samples, count: int, seed: int) -> list[Batch]:
    """About `count` samples, spread evenly over images and half angles; one batch per image."""
    generator = np.random.default_rng(seed)
    quota = max(count // max(len(samples.images), 1), 256)
    batches = []
    for position, image in enumerate(samples.images):
        index = samples.indices(position)
        if not len(index):
            continue
        if len(index) > quota:
            drawn = generator.choice(index, min(len(index), _CANDIDATES * quota), replace=False)
            index = np.sort(_even(samples, image, drawn, quota, generator))
        batches.append(samples.at(image, index, cluster=position * BLOCKS))
        samples.capture.release(image)
    return batches


def _even(samples: Samples, image: int, index: np.ndarray, quota: int, generator: np.random.Generator) -> np.ndarray:
    """`quota` of the pixels `index`, as evenly over the classes of half angle as they are filled."""
    points = samples.at(image, index).points
    if not points.wi.shape[-2]:
        return index[:quota]
    angles = torch.rad2deg(lit_directions(points).theta_half[..., 0])
    reached = gathered_light(points).amax(-1) > 0
    degrees = torch.where(reached, angles, 90.0).amin(-1)
    classes = torch.bucketize(degrees, _HALF_ANGLES.to(degrees)).cpu().numpy()
    order = generator.permutation(len(index))
    # Rank within its class: taking the lowest ranks fills all classes alike.
    rank = np.empty(len(index), dtype=np.int64)
    for label in np.unique(classes):
        members = order[classes[order] == label]
        rank[members] = np.arange(len(members))
    return index[np.argsort(rank, kind="stable")[:quota]]
