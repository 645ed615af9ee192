"""A small sample of photographs in which every class of half angle has its share."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import torch

from matest.directions import dot
from matest.photographs.pixels import BLOCKS, LitPixels
from matest.photographs.strata import one_per_stratum
from matest.samples import Batch
from matest.workers import in_threads

# Classes of the angle between half vector and normal, degrees: highlights are small and must not be missed.
_HALF_ANGLES = torch.tensor([2.0, 4.0, 8.0, 16.0, 32.0])
CLASSES = len(_HALF_ANGLES) + 1
# Pixels with a known half angle for each sample of the pilot: enough to fill small classes.
_CANDIDATES = 8
# Pixels of an image that are all candidates: to classify so many takes a few milliseconds.
_ALL_CANDIDATES = 16_384
# Fewest samples of an image, however many images there are: some for each class.
_MIN_QUOTA = 256


def pilot(pixels: LitPixels, count: int, seed: int) -> list[Batch]:
    """About `count` samples, spread evenly over images and half angles; one batch per image."""
    quota = max(count // max(len(pixels.images), 1), _MIN_QUOTA)

    def draw(position: int) -> list[Batch]:
        image, usable, available = pixels.images[position], pixels.usable(position), pixels.counts[position]
        if not available:
            return []
        generator = np.random.default_rng((seed, position))
        if available > max(_CANDIDATES * quota, _ALL_CANDIDATES):
            # Draw so many pixels that about `_CANDIDATES * quota` of them are usable.
            index = one_per_stratum(len(usable), _CANDIDATES * quota * len(usable) // available, generator)
            index = index[usable[index]]
        else:
            index = np.flatnonzero(usable)
        if len(index) > quota:
            index = _even(pixels, image, index, quota, generator)
        # One group per image: a block has too few of these pixels to show correlated errors.
        batch = replace(pixels.at(position, index), groups=torch.full((len(index),), position * BLOCKS))
        pixels.photographs.release(image)
        return [batch]

    return list(itertools.chain.from_iterable(in_threads(draw, range(len(pixels.images)))))


def _even(pixels: LitPixels, image: int, index: np.ndarray, quota: int, generator: np.random.Generator) -> np.ndarray:
    """`quota` of the pixels `index`, spread as evenly over the classes of half angle as their sizes allow."""
    classes = half_angles(pixels, image, index)
    order = generator.permutation(len(index))
    # Class by class, in random order within each.
    members = order[np.argsort(classes[order], kind="stable")]
    counts = np.bincount(classes, minlength=CLASSES)
    ends = counts.cumsum()
    selection, remaining = [], quota
    for rank, label in enumerate(np.argsort(counts)):
        # The smallest classes come first and give all their pixels; the larger ones share the remaining quota.
        size = min(int(counts[label]), remaining // (CLASSES - rank))
        selection.append(members[ends[label] - counts[label] :][:size])
        remaining -= size
    return index[np.sort(np.concatenate(selection))]


def half_angles(pixels: LitPixels, image: int, index: np.ndarray) -> np.ndarray:
    """Class of the smallest half angle among the lights that reach each pixel, uint8 [n]."""
    surface, selection = pixels.photographs.scene.surface, torch.from_numpy(index)
    normals = surface.normals_as(torch.float32).detach()[selection]
    view = surface.toward_viewer(selection).detach().float()
    largest = torch.zeros(len(normals))
    for toward, reaches in pixels.lights(image, selection):
        cosine = dot(normals, torch.nn.functional.normalize(toward + view, dim=-1))
        largest = torch.maximum(largest, cosine * reaches)
    return torch.bucketize(-largest, -torch.cos(torch.deg2rad(_HALF_ANGLES))).to(torch.uint8).numpy()
