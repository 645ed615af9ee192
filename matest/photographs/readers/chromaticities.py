"""Colours of other primaries than Rec.709, as the header of a file may state them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from matest.errors import InputError

# x and y of red, green, blue and white (D65).
_REC_709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
# Chromaticities nearer than this are the same: files round them to three or four digits.
_ROUNDING = 1e-3


def to_rec709(path: Path, chromaticities: Sequence[float]) -> np.ndarray | None:
    """The matrix [3, 3] from linear RGB of some primaries to Rec.709; None where they are those.

    White stays white: other whites than D65 are adapted by Bradford's matrix.

    Args:
        path: of the file, for the refusal.
        chromaticities: x and y of red, green, blue and white.

    Raises:
        InputError: they span no colours.
    """
    if np.abs(np.subtract(chromaticities, _REC_709)).max() < _ROUNDING:
        return None
    # Loading it takes a second of processor time.
    import colour

    def to_xyz(values: Sequence[float]) -> np.ndarray:
        return colour.normalised_primary_matrix(np.reshape(values[:6], (3, 2)), np.array(values[6:]))

    def white(values: Sequence[float]) -> np.ndarray:
        return colour.xy_to_XYZ(np.array(values[6:]))

    try:
        adaptation = colour.adaptation.matrix_chromatic_adaptation_VonKries(
            white(chromaticities), white(_REC_709), transform="Bradford"
        )
        matrix = np.linalg.solve(to_xyz(_REC_709), adaptation @ to_xyz(chromaticities))
    except np.linalg.LinAlgError:
        matrix = np.full((3, 3), np.nan)
    if not np.isfinite(matrix).all():
        listed = ", ".join(f"{value:.4g}" for value in chromaticities)
        raise InputError(f"{path}: its chromaticities span no colours ({listed}); correct or remove the attribute.")
    return matrix
