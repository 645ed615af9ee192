"""From spectra to linear RGB with the primaries and the white of Rec. 709 and sRGB. Wavelengths in µm."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from matest.errors import InputError, nearest

# Wavelengths of both the tables of the eye and those of daylight, µm: 0.36 to 0.78, every 5 nm.
VISIBLE = torch.linspace(0.36, 0.78, 85, dtype=torch.float64)

# Linear RGB from XYZ, as IEC 61966-2-1 prints it.
_RGB_OF_XYZ = ((3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570))
# Luminance of linear RGB, from the same standard: consistent with the matrix to 3e-5.
_Y_OF_RGB = (0.2126, 0.7152, 0.0722)


def to_rgb(spectrum: Tensor, wavelengths: Tensor = VISIBLE, illuminant: str = "D65") -> Tensor:
    """Linear RGB [..., 3] of a reflectance spectrum [..., Λ] seen under an illuminant.

    XYZ = k Σ E R (x̄, ȳ, z̄) Δλ,  k = 1/(Σ E ȳ Δλ),  RGB = M⁻¹ XYZ

    The white is not adapted: a perfect white has Y = 1 under every illuminant, RGB = (1, 1, 1) within 1e-4 under D65
    at the default wavelengths, and the tint of any other illuminant. Saturated colours have a negative channel, see
    `desaturate`.

    Args:
        spectrum: reflectance, or radiance relative to that of a perfect white; differentiable.
        wavelengths: [Λ] in µm, increasing; the observer is blind outside 0.36 to 0.83.
        illuminant: a name that `illuminant` knows.

    Raises:
        InputError: wavelengths that do not increase; see also `illuminant`.

    Source: CIE 15, 2° observer of 1931; Cook & Torrance 1982; M⁻¹ of IEC 61966-2-1.
    """
    return spectrum @ torch.from_numpy(_weights(illuminant, tuple(wavelengths.tolist()))).to(spectrum)


def illuminant(name: str, wavelengths: Tensor = VISIBLE) -> Tensor:
    """Relative spectral power [Λ] of a CIE illuminant such as D65, A or FL2 at wavelengths [Λ] in µm.

    Linear between the tabulated values. D65 and A reach from 0.3 to 0.78, fluorescent lamps from 0.38: for those take
    `VISIBLE[4:]`.

    Raises:
        InputError: an unknown name, or wavelengths outside the table.

    Source: CIE 15, as tabulated by colour-science.
    """
    import colour

    if name not in colour.SDS_ILLUMINANTS:
        raise InputError(f"unknown illuminant '{name}'; {nearest(name, colour.SDS_ILLUMINANTS)}")
    table = colour.SDS_ILLUMINANTS[name]
    nanometres = 1000 * wavelengths.numpy(force=True)
    start, end = table.wavelengths[[0, -1]]
    if not ((nanometres >= start) & (nanometres <= end)).all():
        raise InputError(
            f"illuminant {name} is tabulated from {start / 1000:g} to {end / 1000:g} µm, "
            f"but wavelengths from {wavelengths.min():g} to {wavelengths.max():g} came; leave out those beyond."
        )
    return torch.from_numpy(np.interp(nanometres, table.wavelengths, table.values)).to(wavelengths)


def luminance(rgb: Tensor) -> Tensor:
    """Y [..., 1] of linear RGB [..., 3]; a white (1, 1, 1) has Y = 1."""
    return (rgb * rgb.new_tensor(_Y_OF_RGB)).sum(-1, keepdim=True)


def desaturate(rgb: Tensor) -> Tensor:
    """The most saturated colour [..., 3] inside the gamut with the luminance Y and dominant wavelength of `rgb`.

    RGB' = (1−u) RGB + u Y (1, 1, 1),  u = max over negative channels of −RGB_c/(Y − RGB_c)

    The smallest channel has the largest u. Colours without a negative channel do not change, even if a channel is above
    1: exposure, not saturation, limits brightness. Where Y ≤ 0 no such colour exists, and the result is black.

    Source: Cook & Torrance 1982 in words (hold dominant wavelength and luminance, lower the purity).
    """
    y = luminance(rgb)
    lowest = rgb.amin(-1, keepdim=True)
    outside, visible = lowest < 0, y > 0
    u = -lowest / torch.where(outside & visible, y - lowest, 1.0)
    mixed = (rgb + u * (y - rgb)).clamp(min=0)
    return torch.where(outside, torch.where(visible, mixed, 0.0), rgb)


@lru_cache
def _weights(name: str, wavelengths: tuple[float, ...]) -> np.ndarray:
    """RGB [Λ, 3] per unit of reflectance at each wavelength."""
    import colour

    at = np.array(wavelengths)
    if len(at) < 2 or not (np.diff(at) > 0).all():
        raise InputError("the wavelengths of a spectrum must be two or more, each above the one before.")
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    power = illuminant(name, torch.from_numpy(at)).numpy() * np.gradient(at)
    response = [np.interp(1000 * at, observer.wavelengths, values, left=0, right=0) for values in observer.values.T]
    xyz = power * np.stack(response)
    # An array, not a tensor: one made in inference mode could not be differentiated later.
    return (np.array(_RGB_OF_XYZ) @ xyz / xyz[1].sum()).T
