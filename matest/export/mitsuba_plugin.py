"""A BSDF of Mitsuba 3 for rough surfaces that it has no plugin for: the sum of lobes that a scene file names.

`import` this file after `mitsuba.set_variant(...)`; scenes may then contain `<bsdf type="matest">`. It needs Mitsuba
alone. Each lobe has a number n, its kind in the string `lobe_n`, and its options and values in `lobe_n_NAME`. Values
may be numbers, colours or textures. With L toward the light, V toward the viewer and H half way between:

lambert                 albedo/π
oren-nayar              Oren & Nayar 1994, eq. 14-16: albedo, sigma (rad), interreflection
oren-nayar-qualitative  the same, eq. 17: albedo, sigma (rad)
fujii                   Fujii's improved form of eq. 17: albedo, sigma (rad), interreflection
eon                     Portsmouth, Kutz & Hill 2024: albedo, diffuse_roughness
microfacet              specular · F D G/(4 cos θi cos θr): slope; distribution beckmann, ggx or gaussian (without its
                        constant); masking v-cavity or smith; fresnel none, dielectric (f0), schlick (f0),
                        colour-shift (f0, f0_mean) or conductor (eta, k)
ward                    Ward 1992: specular, slope_x, slope_y; form ward, duer or bounded
li-torrance-directional, li-torrance-subsurface, li-torrance-forward
                        Li & Torrance 2005, eq. 9, 12 and 13: k, f0, slope_ratio σ/τ, or with anisotropy printed or
                        corrected slope_ratio_x and slope_ratio_y; masking on or off; law printed or reciprocal

Slopes with x are those along u of the surface, with y along v.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi

# Kinds that reflect into all directions alike; the others are sampled about the mirror direction too.
_BODIES = {"lambert", "oren-nayar", "oren-nayar-qualitative", "fujii", "eon", "li-torrance-subsurface"}
_COLOURS = {"albedo", "specular", "k", "f0", "eta", "extinction"}
_WORDS = {"distribution", "masking", "fresnel", "law", "form", "anisotropy"}
# Slopes and cosines below these are replaced by them: the lobes divide by them.
_SLOPE_FLOOR = 1e-3
_COS_FLOOR = 1e-4
# Width at which forward scattering, which has no facets of its own, is sampled.
_WIDE = 0.5
# Smallest effective roughness σe/σ of Li and Torrance's surfaces.
_EFFECTIVE_FLOOR = 1e-4

# A value of the lobe by its name, at the point that is shaded.
Values = Callable[[str], Any]


class Pair:
    """Directions to the light and to the viewer in the local frame, and the angles between them."""

    def __init__(self, light: Any, viewer: Any) -> None:
        self.cos_i, self.cos_o = dr.maximum(light.z, _COS_FLOOR), dr.maximum(viewer.z, _COS_FLOOR)
        self.sin_i, self.sin_o = _sine(light), _sine(viewer)
        # sin θi sin θr times cosine and sine of the azimuth between them.
        self.tangential = light.x * viewer.x + light.y * viewer.y
        self.crosswise = light.x * viewer.y - light.y * viewer.x
        half = light + viewer
        self.hx, self.hy = (side / dr.maximum(half.z, 1e-5) for side in (half.x, half.y))
        # cos² of the azimuths of light and viewer from u.
        self.share_i, self.share_o = dr.square(light.x / self.sin_i), dr.square(viewer.x / self.sin_o)
        self.cos_d = dr.minimum(0.5 * dr.norm(half), 1.0)
        self.tan2_half = (dr.square(half.x) + dr.square(half.y)) / dr.square(dr.maximum(half.z, 1e-5))
        self.cos2_half = 1 / (1 + self.tan2_half)


def _sine(direction: Any) -> Any:
    return dr.maximum(dr.sqrt(dr.square(direction.x) + dr.square(direction.y)), 1e-6)


def lambert(_: Pair, value: Values, __: dict[str, str]) -> Any:
    return value("albedo") / math.pi


def oren_nayar(pair: Pair, value: Values, _: dict[str, str]) -> Any:
    sigma2 = dr.square(value("sigma"))
    smaller, larger = dr.minimum(pair.cos_i, pair.cos_o), dr.maximum(pair.cos_i, pair.cos_o)
    alpha, beta = dr.acos(dr.minimum(smaller, 1.0)), dr.acos(dr.minimum(larger, 1.0))
    cos_phi = pair.tangential / (pair.sin_i * pair.sin_o)
    b = 0.45 * sigma2 / (sigma2 + 0.09)
    c2 = b * (dr.maximum(pair.sin_i, pair.sin_o) - dr.select(cos_phi < 0, (2 * beta / math.pi) ** 3, 0.0))
    c3 = 0.125 * sigma2 / (sigma2 + 0.09) * dr.square(4 * alpha * beta / math.pi**2)
    direct = 1 - 0.5 * sigma2 / (sigma2 + 0.33) + cos_phi * c2 * dr.tan(beta)
    direct += (1 - dr.abs(cos_phi)) * c3 * dr.tan(0.5 * (alpha + beta))
    bounce = 0.17 * sigma2 / (sigma2 + 0.13) * (1 - cos_phi * dr.square(2 * beta / math.pi))
    albedo = value("albedo")
    return (albedo * direct + dr.square(albedo) * value("interreflection") * bounce) / math.pi


def oren_nayar_qualitative(pair: Pair, value: Values, _: dict[str, str]) -> Any:
    sigma2 = dr.square(value("sigma"))
    rise = dr.maximum(pair.tangential, 0.0) / dr.maximum(pair.cos_i, pair.cos_o)
    return value("albedo") * (1 - 0.5 * sigma2 / (sigma2 + 0.33) + 0.45 * sigma2 / (sigma2 + 0.09) * rise) / math.pi


def _azimuthal(pair: Pair) -> Any:
    """Fujii's s/t."""
    return pair.tangential / dr.select(pair.tangential > 0, dr.maximum(pair.cos_i, pair.cos_o), 1.0)


def fujii(pair: Pair, value: Values, _: dict[str, str]) -> Any:
    sigma2, albedo = dr.square(value("sigma")), value("albedo")
    direct = 1 - 0.5 * sigma2 / (sigma2 + 0.33) + 0.45 * sigma2 / (sigma2 + 0.09) * _azimuthal(pair)
    bounce = value("interreflection") * 0.17 * sigma2 / (sigma2 + 0.13)
    return (albedo * direct + dr.square(albedo) * bounce) / math.pi


def eon(pair: Pair, value: Values, _: dict[str, str]) -> Any:
    c1, c2 = 0.5 - 2 / (3 * math.pi), 2 / 3 - 28 / (15 * math.pi)
    albedo, r = value("albedo"), value("diffuse_roughness")
    scale = 1 / (1 + c1 * r)
    average = scale * (1 + c2 * r)
    bounced = dr.square(albedo) * average / (1 - albedo * (1 - average))

    def loss(cos: Any, sin: Any) -> Any:
        rest = (2 / 3) * (cos * (1 + sin + sin * sin) / (1 + sin) - 1)
        return c1 - sin * (dr.acos(dr.minimum(cos, 1.0)) - sin * cos + rest) / math.pi

    multiple = r * loss(pair.cos_i, pair.sin_i) * loss(pair.cos_o, pair.sin_o) / (c1 - c2)
    return scale * (albedo * (1 + r * _azimuthal(pair)) + bounced * multiple) / math.pi


def microfacet(pair: Pair, value: Values, words: dict[str, str]) -> Any:
    slope = dr.maximum(value("slope"), _SLOPE_FLOOR)
    lobe = _DISTRIBUTIONS[words["distribution"]](pair, slope) * _masked(pair, slope, words)
    return value("specular") * lobe * _FRESNEL[words["fresnel"]](pair.cos_d, value)


def _beckmann(pair: Pair, slope: Any) -> Any:
    m2 = dr.square(slope)
    return dr.exp(-pair.tan2_half / m2) * dr.square(1 + pair.tan2_half) / (math.pi * m2)


def _ggx(pair: Pair, slope: Any) -> Any:
    m2 = dr.square(slope)
    return 1 / (math.pi * m2 * dr.square(pair.cos2_half * (1 + pair.tan2_half / m2)))


def _gaussian(pair: Pair, slope: Any) -> Any:
    return dr.exp(-dr.square(dr.atan(dr.sqrt(pair.tan2_half)) / slope))


_DISTRIBUTIONS = {"beckmann": _beckmann, "ggx": _ggx, "gaussian": _gaussian}


def _masked(pair: Pair, slope: Any, words: dict[str, str]) -> Any:
    """G/(4 cos θi cos θr)."""
    free = 0.25 / (pair.cos_i * pair.cos_o)
    if words["masking"] == "v-cavity":
        heights = pair.cos_i + pair.cos_o
        return dr.minimum(free, heights / dr.maximum(pair.cos_i, pair.cos_o) / dr.square(2 * pair.cos_d))
    smith = _smith_ggx if words["distribution"] == "ggx" else _smith_beckmann
    return free * smith(pair.cos_i, pair.sin_i, slope) * smith(pair.cos_o, pair.sin_o, slope)


def _smith_ggx(cos: Any, sin: Any, slope: Any) -> Any:
    return 2 * cos / (cos + dr.sqrt(cos * cos + dr.square(slope * sin)))


def _smith_beckmann(cos: Any, sin: Any, slope: Any) -> Any:
    a = dr.minimum(cos / (slope * sin), 6.5)
    root = math.sqrt(math.pi)
    return 2 * root * a / (root * a * (1 + dr.erf(a)) + dr.exp(-a * a))


def _white(_: Any, __: Values) -> Any:
    return 1.0


def _dielectric(c: Any, value: Values) -> Any:
    return _dielectric_of(c, value("f0"))


def _dielectric_of(c: Any, f0: Any) -> Any:
    root = dr.sqrt(dr.minimum(dr.maximum(f0, 1e-6), 1 - 1e-4))
    rest = 4 * root / dr.square(1 - root)
    plus = dr.sqrt(rest + c * c) + c
    minus = rest / plus
    return 0.5 * dr.square(minus / plus) * (1 + dr.square((c * plus - 1) / (c * minus + 1)))


def _schlick(c: Any, value: Values) -> Any:
    f0 = value("f0")
    return f0 + (1 - f0) * (1 - c) ** 5


def _colour_shift(c: Any, value: Values) -> Any:
    f0, mean = value("f0"), value("f0_mean")
    return f0 + (1 - f0) * dr.maximum(_dielectric_of(c, mean) - mean, 0.0) / (1 - mean)


def _conductor(c: Any, value: Values) -> Any:
    eta, k = value("eta"), value("extinction")
    c2, s2 = c * c, 1 - c * c
    t = eta * eta - k * k - s2
    modulus = dr.sqrt(t * t + 4 * dr.square(eta * k))
    a = dr.sqrt(dr.maximum(0.5 * (modulus + t), 0.0))
    across = (modulus + c2 - 2 * a * c) / (modulus + c2 + 2 * a * c)
    along = (c2 * modulus + s2 * s2 - 2 * a * c * s2) / (c2 * modulus + s2 * s2 + 2 * a * c * s2)
    return 0.5 * across * (1 + along)


_FRESNEL = {
    "none": _white,
    "dielectric": _dielectric,
    "schlick": _schlick,
    "colour-shift": _colour_shift,
    "conductor": _conductor,
}


def ward(pair: Pair, value: Values, words: dict[str, str]) -> Any:
    distribution = _two_slopes(pair, *(dr.maximum(value(name), _SLOPE_FLOOR) for name in ("slope_x", "slope_y")))
    if words["form"] == "bounded":
        return value("specular") * distribution / dr.square(2 * pair.cos_d)
    product = pair.cos_i * pair.cos_o
    lobe = 0.25 * distribution * dr.square(pair.cos2_half)
    return value("specular") * lobe / (dr.sqrt(product) if words["form"] == "ward" else product)


def _two_slopes(pair: Pair, x: Any, y: Any) -> Any:
    """Beckmann's distribution of slopes x along u and y along v."""
    return dr.exp(-dr.square(pair.hx / x) - dr.square(pair.hy / y)) * dr.square(1 + pair.tan2_half) / (math.pi * x * y)


def directional(pair: Pair, value: Values, words: dict[str, str]) -> Any:
    slopes, share = _effective_slopes(pair, value, words)
    lobe = _two_slopes(pair, *slopes) * 0.25 * share / (pair.cos_i * pair.cos_o)
    return value("k") * _schlick(pair.cos_d, value) * lobe


def _effective_slopes(pair: Pair, value: Values, words: dict[str, str]) -> tuple[list[Any], Any]:
    """2 σe/τ along u and v, and the share S that is neither masked nor shadowed."""
    law = words["anisotropy"]
    ratios = [value(f"slope_ratio{axis}") for axis in (("", "") if law == "none" else ("_x", "_y"))]
    if words["masking"] == "off":
        return [dr.maximum(2 * ratio, _SLOPE_FLOOR) for ratio in ratios], 1.0
    exponents = [_exponent(ratios, share, law) for share in (pair.share_i, pair.share_o)]

    def covered(factor: float) -> list[Any]:
        sides = zip((pair.cos_i, pair.cos_o), exponents, strict=True)
        return [1 - dr.power(dr.maximum(1 - cos, 1e-7), factor * exponent) for cos, exponent in sides]

    logs = [e * dr.log(dr.maximum(side, 1e-30)) for e, side in zip(exponents, covered(1.6), strict=True)]
    effective = dr.exp(dr.maximum(0.1 * (logs[0] + logs[1]), math.log(_EFFECTIVE_FLOOR)))
    toward, away = covered(1.0)
    return [dr.maximum(2 * ratio * effective, _SLOPE_FLOOR) for ratio in ratios], toward * away


def _exponent(ratios: list[Any], share: Any, law: str) -> Any:
    """τ/σ along an azimuth whose cos² is `share`."""
    x, y = (dr.square(ratio) for ratio in ratios)
    along = share / x + (1 - share) / y if law != "corrected" else 1 / (share * x + (1 - share) * y)
    return dr.minimum(dr.maximum(dr.sqrt(along), 0.1), 1e3)


def subsurface(pair: Pair, value: Values, _: dict[str, str]) -> Any:
    return value("k") * dr.square(1 - value("f0")) * _transmitted(pair)


def _transmitted(pair: Pair) -> Any:
    """Both transmittances of the mean surface over their value at normal incidence, divided by π."""
    return (1 - (1 - pair.cos_i) ** 5) * (1 - (1 - pair.cos_o) ** 5) / math.pi


def forward(pair: Pair, value: Values, words: dict[str, str]) -> Any:
    x, y = (0.25 / dr.square(dr.maximum(slope, 2e-2)) for slope in _effective_slopes(pair, value, words)[0])

    def width(share: Any) -> Any:
        return share * x + (1 - share) * y

    ahead = dr.maximum(-pair.tangential, 0.0)

    def tan2(sin: Any, cos: Any) -> Any:
        return (dr.square(cos) + dr.square(pair.crosswise / sin)) / dr.maximum(dr.square(ahead / sin), 1e-6)

    exponent = tan2(pair.sin_i, pair.cos_o) * width(pair.share_i)
    if words["law"] == "reciprocal":
        exponent = 0.5 * (exponent + tan2(pair.sin_o, pair.cos_i) * width(pair.share_o))
    lobe = dr.select(ahead > 0, dr.exp(-exponent), 0.0) * (1 - pair.cos_i) * (1 - pair.cos_o)
    return value("k") * dr.square(1 - value("f0")) * lobe * _transmitted(pair)


LOBES: dict[str, Callable[[Pair, Values, dict[str, str]], Any]] = {
    "lambert": lambert,
    "oren-nayar": oren_nayar,
    "oren-nayar-qualitative": oren_nayar_qualitative,
    "fujii": fujii,
    "eon": eon,
    "microfacet": microfacet,
    "ward": ward,
    "li-torrance-directional": directional,
    "li-torrance-subsurface": subsurface,
    "li-torrance-forward": forward,
}


class Matest(mi.BSDF):
    """The sum of the lobes that the scene file names, on the front side of a surface."""

    def __init__(self, props: Any) -> None:
        mi.BSDF.__init__(self, props)
        self.lobes: list[tuple[str, dict[str, str], dict[str, Any]]] = []
        names = list(props.keys())
        while f"lobe_{len(self.lobes)}" in names:
            head = f"lobe_{len(self.lobes)}"
            of_lobe = [name.removeprefix(f"{head}_") for name in names if name.startswith(f"{head}_")]
            words = {name: props[f"{head}_{name}"] for name in of_lobe if name in _WORDS}
            values = {name: props.get_unbounded_texture(f"{head}_{name}") for name in of_lobe if name not in _WORDS}
            self.lobes.append((props[head], words, values))
        self.glossy = [lobe for lobe in self.lobes if lobe[0] not in _BODIES]
        flags = mi.BSDFFlags.FrontSide | mi.BSDFFlags.DiffuseReflection
        flags |= mi.BSDFFlags.GlossyReflection if self.glossy else 0
        self.m_components, self.m_flags = [flags], flags

    def traverse(self, callback: Any) -> None:
        for number, (_, _, values) in enumerate(self.lobes):
            for name, texture in values.items():
                callback.put(f"lobe_{number}_{name}", texture, mi.ParamFlags.Differentiable)

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        viewer_first = ctx.mode == mi.TransportMode.Radiance
        pair = Pair(wo, si.wi) if viewer_first else Pair(si.wi, wo)
        total = mi.Spectrum(0.0)
        for kind, words, values in self.lobes:

            def value(name: str, values: dict[str, Any] = values) -> Any:
                texture = values[name]
                return texture.eval(si, active) if name in _COLOURS else texture.eval_1(si, active)

            total += LOBES[kind](pair, value, words)
        above = active & (si.wi.z > 0) & (wo.z > 0)
        return dr.select(above, dr.maximum(total, 0.0) * wo.z, mi.Spectrum(0.0))

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        del ctx
        half = dr.normalize(si.wi + wo)
        cos2 = dr.maximum(dr.square(half.z), 1e-10)
        density = mi.warp.square_to_cosine_hemisphere_pdf(wo)
        for slope in self._widths(si, active):
            m2 = dr.square(slope)
            facets = half.z / (math.pi * m2 * dr.square(cos2 * (1 + (1 / cos2 - 1) / m2)))
            density += facets / (4 * dr.maximum(dr.abs(dr.dot(wo, half)), 1e-6))
        above = active & (si.wi.z > 0) & (wo.z > 0)
        return dr.select(above, density / (1 + len(self.glossy)), 0.0)

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> tuple[Any, Any]:
        """Even over the hemisphere, or about the mirror direction by facets of GGX, whose tails are the longest."""
        choice = sample1 * (1 + len(self.glossy))
        wo = mi.warp.square_to_cosine_hemisphere(sample2)
        for number, slope in enumerate(self._widths(si, active), 1):
            tan2 = dr.square(slope) * sample2.x / dr.maximum(1 - sample2.x, 1e-6)
            cos, phi = dr.rsqrt(1 + tan2), 2 * math.pi * sample2.y
            sin = cos * dr.sqrt(tan2)
            facet = mi.Vector3f(sin * dr.cos(phi), sin * dr.sin(phi), cos)
            mirrored = 2 * dr.dot(si.wi, facet) * facet - si.wi
            wo = dr.select((choice >= number) & (choice < number + 1), mirrored, wo)
        sample: Any = dr.zeros(mi.BSDFSample3f)
        sample.wo, sample.eta = wo, 1.0
        sample.sampled_type, sample.sampled_component = mi.UInt32(int(self.m_flags)), mi.UInt32(0)
        sample.pdf = self.pdf(ctx, si, wo, active)
        valid = sample.pdf > 0
        weight = self.eval(ctx, si, wo, active) / dr.select(valid, sample.pdf, 1.0)
        return sample, dr.select(valid, weight, mi.Spectrum(0.0))

    def _widths(self, si: Any, active: Any) -> list[Any]:
        """The widths that directions about the mirror direction are drawn with, one a glossy lobe."""
        widths = []
        for kind, _, values in self.glossy:
            if kind == "li-torrance-forward":
                widths.append(_WIDE)
                continue
            # The wider of two directions: its density covers the other.
            names = [name for name in values if name.startswith("slope")]
            widest = dr.maximum(values[names[0]].eval_1(si, active), values[names[-1]].eval_1(si, active))
            widths.append(dr.maximum(2 * widest if kind == "li-torrance-directional" else widest, 1e-2))
        return widths

    def to_string(self) -> str:
        return f"Matest[{', '.join(kind for kind, _, _ in self.lobes)}]"


mi.register_bsdf("matest", Matest)
