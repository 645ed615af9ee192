"""How large the pictures of a report are."""

from __future__ import annotations

import math
from enum import StrEnum

# Longest side of a preview, pixels: enough to fill half a screen.
MAX_PREVIEW_SIDE = 800
# No preview is made smaller than this, pixels: the page shows pictures 311 wide.
MIN_PREVIEW_SIDE = 250
# A preview shows one pixel of 4×4 where both limits allow it: twelve photographs of a megapixel are then drawn in less
# than half the time that decoding them takes.
_STEP = 4


class PictureSize(StrEnum):
    """The pictures that a report has: previews, pictures as large as the photographs, or none."""

    PREVIEW = "preview"
    FULL = "full"
    NONE = "none"

    def step(self, shape: tuple[int, int]) -> int | None:
        """Distance in pixels between those that a picture of an H×W photograph shows; None without pictures."""
        if self is PictureSize.NONE:
            return None
        if self is PictureSize.FULL:
            return 1
        side = max(shape)
        return max(1, min(_STEP, side // MIN_PREVIEW_SIDE), math.ceil(side / MAX_PREVIEW_SIDE))
