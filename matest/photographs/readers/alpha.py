"""Alpha that a file has multiplied into its colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from matest.errors import InputError

NOTE = "alpha was multiplied into the colours and is divided out; pixels of alpha 0 are 0"


def without_alpha(path: Path, colours: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Float colours [H, W, C] divided by their alpha [H, W]; 0 where it is not positive.

    Raises:
        InputError: alpha is 0 everywhere but colours are not: they cannot have been multiplied by it.
    """
    covered = alpha > 0
    if not covered.any() and colours.any():
        raise InputError(
            f"{path}: alpha is 0 everywhere and the colours are not; remove the alpha channel if it means nothing."
        )
    divisor = np.where(covered, alpha, 1).astype(np.float32)[..., None]
    # Alpha next to 0 can give infinite values: these are refused, as those of a file are.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(covered[..., None], colours.astype(np.float32) / divisor, np.float32(0))
