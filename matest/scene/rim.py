"""The rim of a surface: the pixels that may mix it with what lies beside or behind it."""

from __future__ import annotations

import numpy as np

# Pixels from the silhouette within which a pixel may mix object and background: optics and mask are accurate to about
# a pixel each.
RIM_WIDTH = 2
# Pixels that are judged at a time: their images take some MB.
_AT_ONCE = 1 << 20
# Rows beside a band on which its rim depends: those of the rim, and one more for a jump of depth in 3×3 pixels.
_MARGIN = RIM_WIDTH + 1
_NEIGHBOURS = np.ones((3, 3), np.uint8)
_WITHIN_RIM = np.ones((2 * RIM_WIDTH + 1, 2 * RIM_WIDTH + 1), np.uint8)


def near_silhouette(
    shape: tuple[int, int], pixels: np.ndarray, depth: np.ndarray | None = None, jump: np.ndarray | None = None
) -> np.ndarray:
    """True for pixels within `RIM_WIDTH` of a silhouette: the object's outline, or a jump in depth across it [N].

    Args:
        shape: of the image (H, W).
        pixels: of the object, flat row-major indices, ascending [N].
        depth: of the surface [N]; None: it has no jumps.
        jump: difference in depth within 3×3 pixels that is one [N].
    """
    import cv2

    height, width = shape
    rim = np.empty(len(pixels), dtype=bool)
    rows = max(_AT_ONCE // width, 1)
    for first in range(0, height, rows):
        top, bottom = max(first - _MARGIN, 0), min(first + rows + _MARGIN, height)
        ends = starts_of_rows(pixels, width, top, first, first + rows, bottom)
        around, within = slice(ends[0], ends[3]), slice(ends[1], ends[2])
        places = pixels[around] - top * width
        inside = np.zeros((bottom - top, width), dtype=np.uint8)
        inside.reshape(-1)[places] = 1
        if depth is not None and jump is not None:
            inside[_jumps(inside, places, depth[around], jump[around])] = 0
        interior = cv2.erode(inside, _WITHIN_RIM, borderType=cv2.BORDER_CONSTANT, borderValue=1)
        rim[within] = interior.reshape(-1)[pixels[within] - top * width] == 0
    return rim


def starts_of_rows(pixels: np.ndarray, width: int, *rows: int) -> np.ndarray:
    """How many of the object's pixels, ascending flat indices [N], lie above each of some rows of an image."""
    # In the type of the pixels, because numpy would convert all of these otherwise; no pixel lies beyond the last row.
    places = np.minimum(np.array(rows) * width, np.iinfo(pixels.dtype).max)
    return np.searchsorted(pixels, places.astype(pixels.dtype))


def _jumps(inside: np.ndarray, places: np.ndarray, depth: np.ndarray, jump: np.ndarray) -> np.ndarray:
    """True where the depth of the object's pixels, at some places of an image, jumps within 3×3 of them [H, W]."""
    import cv2

    image, allowed = np.zeros(inside.shape, np.float32), np.zeros(inside.shape, np.float32)
    image.reshape(-1)[places], allowed.reshape(-1)[places] = depth, jump
    span = cv2.morphologyEx(image, cv2.MORPH_GRADIENT, _NEIGHBOURS)
    return (span > allowed) & (cv2.erode(inside, _NEIGHBOURS) > 0)
