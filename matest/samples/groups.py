"""How samples are grouped: what sums are kept apart by."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True, eq=False)
class Groups:
    """G groups of samples. Every sample carries the label of its group, and every group belongs to one image.

    A group is a block of neighbouring pixels, whose errors may be correlated; an image is whatever was measured at
    once, under the same lights and with the same exposure.

    Attributes:
        image: that each group belongs to, int64 [G].
    """

    image: Tensor
