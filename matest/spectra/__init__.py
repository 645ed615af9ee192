"""Spectra: from reflectance per wavelength to linear RGB, and the optical constants of metals. Wavelengths in µm."""

from matest.spectra.colour import VISIBLE, desaturate, illuminant, luminance, to_rgb
from matest.spectra.optical_constants import OpticalConstants, metal_colour, normal_reflectance, optical_constants

__all__ = [
    "VISIBLE",
    "OpticalConstants",
    "desaturate",
    "illuminant",
    "luminance",
    "metal_colour",
    "normal_reflectance",
    "optical_constants",
    "to_rgb",
]
