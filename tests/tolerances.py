"""Every tolerance of the tests of models and directions. A looser one needs its reason beside it."""

from __future__ import annotations

from typing import NamedTuple

# float64 against 50 digits or against the same quantity by another route: rounding grows with the exponent of a lobe
# (700 at the edge of underflow), so a few thousand units in the last place.
INDEPENDENT = 1e-12
# Values below this are underflow of a lobe, where relative accuracy has no meaning.
UNDERFLOW = 1e-290
# Nine printed digits: half a unit of the last one, worst for a leading 1.
NINE_DIGITS = 5e-9
# Albedos printed to three decimals: half a unit, and the error of the quadrature.
THREE_DECIMALS = 6e-4
TWO_DECIMALS = 5.5e-3
# Codes of 255 by which a relit picture may be off what the model gives: interpolation of its tables, half floats and
# rounding of the screen; of a glossy surface (slope 0.1) twice that, on the flank of its highlight.
RELIT_MATTE = 2.0
RELIT_GLOSSY = 4.0
# How far an approximation is from what it approximates, measured to three decimals, and the grid it is sought on.
MEASURED_DEVIATION = 6e-4
# Radiance printed to one decimal, of about 74 for Lambert: half a unit, and 4e-4 of Lambert from the quadrature.
ONE_DECIMAL = 0.08
# White lobe against an integral over facet slopes: f0 stops 1e-4 short of 1, and the quadrature crosses kinks of G.
PERFECT_REFLECTOR = 4e-4
# float32 against float64 on the same float32 inputs, relative or as a fraction of the model's peak.
FLOAT32 = 1e-4
FLOAT32_OF_PEAK = 1e-6
# cos 89.9°: closer to grazing float32 is not held to `FLOAT32`.
NEARLY_GRAZING = 1.75e-3
# Geometry in float32: a few units in the last place.
FLOAT32_GEOMETRY = 2e-6
# Central differences with a step of 1e-6: 1e-10 of rounding, and third derivatives of the sharpest lobe drawn.
DIFFERENCES = 1e-6
# White furnace: error of the quadrature for the narrowest lobe it sees (slope or sigma 0.1).
FURNACE = 1e-3
# Fujii's lobe has kinks in polar angle and azimuth: 128 nodes of each.
EON_FURNACE = 2e-4
# A smooth function integrated over the hemisphere.
NORMALISATION = 1e-9
# Albedo of a lobe of slope 0.05 against the reflectance at its centre: the lobe averages over 3 degrees.
SMOOTH_LIMIT = 0.01
# Unconstrained and back: the logistic loses digits near the ends of a domain.
ROUND_TRIP = 1e-12
ROUND_TRIP_FLOAT32 = 1e-5
# Values at an end of their domain are taken this far inside it, as a fraction of its width.
END_OF_DOMAIN = 1.1e-6

# In the plane of incidence the half azimuth is at its floor of 5e-7 rad, where a kink lies.
IN_PLANE = 1e-6
# Mean over 64 orientations of one slope, in units of the Lambert radiance, up to 80 degrees from the normal: the
# integrand has kinks where a facet begins to be shadowed or masked.
ORIENTATIONS = 5e-4


class Excess(NamedTuple):
    """Largest directional albedo of a model that reflects more light than arrives, and why."""

    largest: float
    reason: str


# Models that are not reciprocal, by the beginning of their expression.
NOT_RECIPROCAL = {
    "li-torrance-forward": "eq. 13 as printed: its angle to the forward direction depends on the viewer alone",
    "li-torrance(forward=on)": "contains forward scattering as printed",
}
# Models that reflect nothing into some directions above the horizon: underflow of a narrow lobe, or half a hemisphere.
DARK = {
    "li-torrance-directional": "effective slopes vanish at grazing incidence: the lobe underflows beside its centre",
    "li-torrance(subsurface=off)": "the directional lobe alone",
    "li-torrance-forward": "no light backward",
    "li-torrance-coherent": "a mirror-like lobe",
}


def is_listed(expression: str, exceptions: dict[str, str]) -> bool:
    """Whether an expression is a listed one, with any option."""
    if exceptions is NOT_RECIPROCAL and "law=reciprocal" in expression:
        return False
    return any(expression == name or expression.startswith(f"{name}(") for name in exceptions)


# The only ones allowed to exceed 1 in a white furnace with light up to 89.5 degrees from the normal.
ALBEDO_EXCESS = {
    "oren-nayar": Excess(
        1.048, "eq. 14-16 are a fit: above 1 at oblique incidence for albedo > 0.95, sigma 1.5 to 35 deg"
    ),
    "oren-nayar-qualitative": Excess(1.015, "eq. 17 is a fit: above 1 at oblique incidence for sigma 5 to 20 deg"),
    "fujii": Excess(
        1.028, "its interreflection is a fit that does not depend on the angles: above 1 for albedo > 0.97"
    ),
    "torrance-sparrow": Excess(10.84, "literal 1967 form, not normalised: specular carries the constant"),
    "cook-torrance(normalisation=ngan)": Excess(1.274, "divisor pi instead of 4: 4/pi times the physical lobe"),
    "cook-torrance(normalisation=paper1982)": Excess(4.0, "the printed 1/pi beside D without its 1/pi: 4 times"),
    "li-torrance(masking=off)": Excess(32.83, "without masking the lobe diverges at grazing incidence"),
    "li-torrance-directional(masking=off)": Excess(32.83, "without masking the lobe diverges at grazing incidence"),
    "li-torrance(coherent=on)": Excess(1.306, "as printed: the rough limit already carries the energy of the mirror"),
    "he-torrance(coherent=on)": Excess(
        1.007, "S and the effective roughness do not conserve energy exactly at grazing"
    ),
    "lafortune": Excess(2.094, "not normalised: the weight carries the constant"),
    "ward(form=duer)": Excess(9.933, "the product of cosines diverges at grazing incidence"),
    "ward(anisotropy=axes)": Excess(1.062, "the root of the cosines diverges at the very end of grazing incidence"),
}

# Errors of conversions in docs/conventions.md, in per cent: relative, where the fit stops, and their last digit.
CONVERSION = 0.02
CONVERSION_DIGIT = 0.06
