"""A stratified subsample: few samples, but every angle that carries information."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import torch

from matest.directions import dot
from matest.photographs.pixels import BLOCKS, LitPixels
from matest.samples import Batch
from matest.workers import in_threads

# Classes of the angle between half vector and normal, degrees: highlights are small and must not be missed.
_HALF_ANGLES = torch.tensor([2.0, 4.0, 8.0, 16.0, 32.0])
CLASSES = len(_HALF_ANGLES) + 1
_CANDIDATES, _FEW = 8, 16_384  # pixels looked at per sample kept; all of fewer


def pilot(pixels: LitPixels, count: int, seed: int) -> list[Batch]:
    """About `count` samples, spread evenly over images and half angles; one batch per image."""
    quota = max(count // max(len(pixels.images), 1), 256)

    def draw(position: int) -> list[Batch]:
        image, usable, available = pixels.images[position], pixels.usable(position), pixels.counts[position]
        if not available:
            return []
        generator = np.random.default_rng((seed, position))
        if available > max(_CANDIDATES * quota, _FEW):
            # As many pixels as have so many usable ones among them.
            index = _one_of_each(len(usable), _CANDIDATES * quota * len(usable) // available, generator)
            index = index[usable[index]]
        else:
            index = np.flatnonzero(usable)
        if len(index) > quota:
            index = _even(pixels, image, index, quota, generator)
        # One group: so few pixels of a block say nothing of its errors.
        batch = replace(pixels.at(position, index), groups=torch.full((len(index),), position * BLOCKS))
        pixels.photographs.release(image)
        return [batch]

    return list(itertools.chain.from_iterable(in_threads(draw, range(len(pixels.images)))))


def _one_of_each(length: int, count: int, generator: np.random.Generator) -> np.ndarray:
    """One place of each of `count` stretches that so many places are cut into: no need to shuffle them all."""
    edges = np.arange(count + 1) * length // count
    return edges[:-1] + (generator.random(count) * np.diff(edges)).astype(np.int64)


def _even(pixels: LitPixels, image: int, index: np.ndarray, quota: int, generator: np.random.Generator) -> np.ndarray:
    """`quota` of the pixels `index`, as evenly over the classes of half angle as they are filled."""
    classes = half_angles(pixels, image, index)
    order = generator.permutation(len(index))
    # Class by class, in random order within each.
    members = order[np.argsort(classes[order], kind="stable")]
    counts = np.bincount(classes, minlength=CLASSES)
    ends = counts.cumsum()
    chosen, left = [], quota
    for waiting, label in enumerate(np.argsort(counts)):
        # Small classes give all they have: the others share what these leave.
        own = min(int(counts[label]), left // (CLASSES - waiting))
        chosen.append(members[ends[label] - counts[label] :][:own])
        left -= own
    return index[np.sort(np.concatenate(chosen))]


def half_angles(pixels: LitPixels, image: int, index: np.ndarray) -> np.ndarray:
    """Class of the smallest half angle among the lights that each pixel faces, uint8 [n]."""
    scene, chosen = pixels.photographs.scene, torch.from_numpy(index)
    surface, shadows = scene.surface, scene.shadows[image] if scene.shadows else None
    normals = surface.normals_as(torch.float32).detach().index_select(0, chosen)
    view = surface.toward_viewer(chosen).detach().float()
    positions = scene.near_positions(image, chosen)
    positions = None if positions is None else positions.detach().float()
    nearest = torch.zeros(len(normals))
    for number, light in enumerate(scene.lights[image]):
        toward, _ = light.to(torch.float32, "cpu").at(positions)
        faces = dot(normals, toward) > 0
        if shadows is not None:
            faces &= torch.from_numpy(~shadows[number][index])
        nearest = torch.maximum(nearest, dot(normals, torch.nn.functional.normalize(toward + view, dim=-1)) * faces)
    return torch.bucketize(-nearest, -torch.cos(torch.deg2rad(_HALF_ANGLES))).to(torch.uint8).numpy()
