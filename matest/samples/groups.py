"""Groups of samples: sums over samples are taken for each group."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from matest.samples.batch import Batch

# What there may be one unknown for, apart from the whole and the channels.
GroupAxis = Literal["image", "light", "group"]


@dataclass(frozen=True, eq=False)
class Groups:
    """G groups of samples. Every sample carries the label of its group, and every group belongs to one image.

    A group is a block of neighbouring pixels, whose errors may be correlated; an image is a set of values measured
    at the same time, under the same lights and with the same exposure.

    Attributes:
        image: that each group belongs to, int64 [G].
        light: that each image was taken under, int64 [I]; None: not every image has one light.
    """

    image: Tensor
    light: Tensor | None = None

    @classmethod
    def single(cls) -> Groups:
        """All samples in one group of one image."""
        return cls(torch.zeros(1, dtype=torch.int64))

    @property
    def images(self) -> int:
        """Number of images."""
        return self.count("image")

    def along(self, axis: GroupAxis) -> Tensor:
        """The image, the light or the group that each group belongs to, int64 [G].

        Raises:
            ValueError: the axis of lights, and not every image has one light.
        """
        if axis == "group":
            return torch.arange(len(self.image))
        if axis == "image":
            return self.image
        if self.light is None:
            raise ValueError("unknowns of each light need images that have one light each and no sky.")
        return self.light[self.image]

    def count(self, axis: GroupAxis) -> int:
        """Number of images, lights or groups."""
        return int(self.along(axis).max()) + 1

    @property
    def setting(self) -> Tensor:
        """The light that each group was taken under or, where images have no light of their own, its image, int64 [G].

        Photographs that repeat each other share what a model misses: they are no independent witnesses of it.
        """
        return self.image if self.light is None else self.along("light")

    @property
    def place(self) -> Tensor:
        """A label of each group's block of pixels and its `setting`, int64 [G]: repeated photographs share labels."""
        return self.setting * int(torch.bincount(self.image).max()) + self.block

    @property
    def block(self) -> Tensor:
        """The block of pixels of each group, int64 [G]: a part of the object, the same in all images."""
        order = torch.argsort(self.image, stable=True)
        sizes = torch.bincount(self.image)
        starts = (sizes.cumsum(0) - sizes).repeat_interleave(sizes)
        return torch.empty_like(self.image).index_put_((order,), torch.arange(len(order)) - starts)

    def group_of(self, batch: Batch) -> Tensor:
        """The group of every sample of a batch, int64 [n]."""
        return torch.zeros(len(batch), dtype=torch.int64) if batch.groups is None else batch.groups.cpu()

    def image_of(self, batch: Batch) -> Tensor:
        """The image of every sample of a batch, int64 [n]."""
        return self.image[self.group_of(batch)]
