"""Groups of samples: sums over samples are taken for each group."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from matest.samples.batch import Batch


@dataclass(frozen=True, eq=False)
class Groups:
    """G groups of samples. Every sample carries the label of its group, and every group belongs to one image.

    A group is a block of neighbouring pixels, whose errors may be correlated; an image is a set of values measured
    at the same time, under the same lights and with the same exposure.

    Attributes:
        image: that each group belongs to, int64 [G].
    """

    image: Tensor

    @classmethod
    def single(cls) -> Groups:
        """All samples in one group of one image."""
        return cls(torch.zeros(1, dtype=torch.int64))

    @property
    def images(self) -> int:
        """Number of images."""
        return int(self.image.max()) + 1

    def image_of(self, batch: Batch) -> Tensor:
        """The image of every sample of a batch, int64 [n]."""
        return self.image[torch.zeros(len(batch), dtype=torch.int64) if batch.groups is None else batch.groups.cpu()]
