"""What photographs themselves say of their sensor: the step of its codes, where it clips, its noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from matest.photographs.codes import Clipping, clipping, code_step, highest
from matest.photographs.images import full_scale
from matest.photographs.noise import Noise, stated_noise
from matest.photographs.noise_estimate import noise_of_photographs
from matest.photographs.photometry import Encoding
from matest.photographs.storage import release
from matest.photographs.windows import windows
from matest.scene import Surface


@dataclass(frozen=True)
class Sensor:
    """A sensor, as far as it is stated or shows in its photographs.

    Attributes:
        encoding: from pixels to radiance.
        noise: read noise with that of rounding, and gain.
        clipping: levels at which values pile up below what was taken for saturation; None: there are none.
    """

    encoding: Encoding
    noise: Noise
    clipping: Clipping | None = None


def sensor_of(
    stored: Sequence[np.ndarray], encoding: Encoding, surface: Surface, noise: Noise | None, *, clips_as_stated: bool
) -> Sensor:
    """The sensor of some photographs.

    Args:
        stored: per image the surface's pixels [N, C] as in the file.
        encoding: as stated.
        surface: their place in the image.
        noise: as stated; None: it is estimated.
        clips_as_stated: whether the saturation is stated; if not, levels at which values pile up are looked for.
    """
    index = windows(surface)
    encoding = replace(encoding, step=code_step(stored, index))
    dtype = stored[0].dtype
    maxima = highest(stored)
    if noise is None:
        # The highest values may be clipped ones; whether they are can only be said beside the noise of the others.
        below = encoding if clips_as_stated else _clipped_at(encoding, maxima.max(axis=0).tolist(), dtype)
        noise = noise_of_photographs(stored, below, index)
    else:
        noise = stated_noise(noise, encoding, stored[0], index)
    clip = None if clips_as_stated else clipping(stored, maxima, encoding, noise)
    for pixels in stored:
        release(pixels)
    return Sensor(encoding if clip is None else _clipped_at(encoding, clip.levels, dtype), noise, clip)


def _clipped_at(encoding: Encoding, levels: Sequence[float | None], dtype: np.dtype) -> Encoding:
    """The encoding with values saturated from these stored ones on, one a channel; None: as before."""
    before = np.broadcast_to(np.inf if encoding.saturation is None else np.asarray(encoding.saturation), len(levels))
    saturation = []
    for level, stated in zip(levels, before.tolist(), strict=True):
        if level is None:
            own = np.inf
        elif dtype.kind == "u":
            own = (level - 0.5) / full_scale(dtype)
        else:
            own = float(np.nextafter(np.float32(level), np.float32(-np.inf)))
        saturation.append(min(own, stated))
    return replace(encoding, saturation=tuple(saturation))
