"""Named parameter sets of the papers: their samples and vases, ready to render."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from torch import Tensor

from matest.brdf.base import Brdf
from matest.brdf.cook_torrance import CookTorrance
from matest.brdf.li_torrance import LiTorrance
from matest.brdf.oren_nayar import OrenNayar
from matest.brdf.oren_nayar_exact import OrenNayarExact
from matest.brdf.torrance_sparrow import TorranceSparrow
from matest.errors import InputError, nearest
from matest.spectra import VISIBLE, metal_colour, normal_reflectance, optical_constants


class Preset(NamedTuple):
    """A material of a paper.

    Attributes:
        doc: what it is.
        source: of its parameters.
        build: makes the model.
        needs_f0: whether `build` takes the reflectance at normal incidence, because the paper does not give it.
    """

    doc: str
    source: str
    build: Callable[..., Brdf]
    needs_f0: bool = False


def preset(name: str, f0: float | Sequence[float] | Tensor | None = None) -> Brdf:
    """The material of that name.

    Args:
        name: a key of `PRESETS`.
        f0: reflectance at normal incidence, one value or one per channel. The nonmetals of Cook and Torrance's Table I
            need it, because the paper does not give their spectra; no other preset takes it.

    Raises:
        InputError: an unknown name, `f0` missing or useless, a metal whose optical constants are not installed.
    """
    if name not in PRESETS:
        raise InputError(f"unknown preset '{name}'; {nearest(name, PRESETS)}")
    entry = PRESETS[name]
    if entry.needs_f0:
        if f0 is None:
            raise InputError(
                f"preset '{name}' needs f0, the reflectance at normal incidence: the paper gives its weights and slope "
                "but not its spectrum."
            )
        return entry.build(f0)
    if f0 is not None:
        raise InputError(f"preset '{name}' has a reflectance of its own; leave out f0.")
    return entry.build()


def _of(kind: type[Brdf], **values: Any) -> Brdf:
    """A model from numbers, which its constructor turns into the tensors of its fields."""
    return kind(**values)


def _rough(albedo: float, sigma: float, sheen: float) -> Brdf:
    """Body and surface of the same slopes; `sheen` = ks/kb with kb = 1."""
    spread = math.radians(sigma)
    return _of(OrenNayar, albedo=albedo, sigma=spread) + _of(TorranceSparrow, specular=sheen, sigma=spread)


def average_reflectance(metal: str) -> float:
    """Reflectance of a metal at normal incidence, averaged over the visible wavelengths: `f0_mean`."""
    return float(normal_reflectance(*optical_constants(metal).at(VISIBLE)).mean())


def _copper_vase() -> Brdf:
    colour = metal_colour("copper").clamp(max=1).tolist()
    average = average_reflectance("copper")
    return _of(
        CookTorrance, diffuse=0.0, specular=1.0, slope=0.4, slope_2=0.2, weight_2=0.6, f0=colour, f0_mean=average,
        lobes="2", fresnel="colour-shift",
    )  # fmt: skip


def _plastic_vase() -> Brdf:
    colour = metal_colour("copper").clamp(max=1).tolist()
    return _of(CookTorrance, diffuse=colour, specular=0.1, slope=0.15, f0=0.04, weights="complementary")


def _nonmetal(specular: float, slope: float) -> Callable[..., Brdf]:
    def build(f0: float | Sequence[float] | Tensor) -> Brdf:
        return _of(CookTorrance, diffuse=f0, specular=specular, slope=slope, f0=f0, weights="complementary")

    return build


def _sample(f0: float, **values: Any) -> Callable[[], Brdf]:
    """A sample of Li and Torrance; components that have no coefficient in its table are off."""
    switches = {
        "directional": "k_dd" in values,
        "uniform": "k_udf" in values,
        "subsurface": "k_uds" in values,
        "forward": "k_fs" in values,
        "coherent": "solid_angle" in values,
    }
    options = {name: "on" if on else "off" for name, on in switches.items()}
    return lambda: _of(LiTorrance, f0=f0, **values, **options)


def _of_index(n: float) -> float:
    return ((n - 1) / (n + 1)) ** 2


_ON94 = "Oren & Nayar 1994, "
_CT82 = "Cook & Torrance 1982, "
_LT05 = "Li & Torrance 2005, "
# Reflectance of aluminium: the tables give none for its films.
_ALUMINIUM = 0.92

PRESETS: dict[str, Preset] = {
    "plaster": Preset("sample A", _ON94 + "fig. 8", lambda: _of(OrenNayarExact, albedo=0.90, sigma=math.radians(30))),
    "sand": Preset("sample B", _ON94 + "fig. 9", lambda: _of(OrenNayarExact, albedo=0.80, sigma=math.radians(35))),
    "foam": Preset("sample C", _ON94 + "fig. 10", lambda: _rough(0.80, 20, 0.019)),
    "towel": Preset("sample D, cloth", _ON94 + "fig. 11", lambda: _rough(0.75, 42, 0.085)),
    "clay-vase": Preset(
        "the clay vase", _ON94 + "fig. 12-13", lambda: _of(OrenNayar, albedo=0.70, sigma=math.radians(40))
    ),
    "copper-vase": Preset("two lobes, colour shift", _CT82 + "fig. 6b", _copper_vase),
    "plastic-vase": Preset("copper-coloured plastic", _CT82 + "fig. 6a", _plastic_vase),
    "carbon": Preset("s 0.3, d 0.7, m 0.40", _CT82 + "Table I", _nonmetal(0.3, 0.40), needs_f0=True),
    "rubber": Preset("s 0.4, d 0.6, m 0.30", _CT82 + "Table I", _nonmetal(0.4, 0.30), needs_f0=True),
    "obsidian": Preset("s 0.8, d 0.2, m 0.15", _CT82 + "Table I", _nonmetal(0.8, 0.15), needs_f0=True),
    "lunar-dust": Preset("s 0, d 1", _CT82 + "Table I", _nonmetal(0.0, 0.5), needs_f0=True),
    "olive-drab": Preset("s 0.3, d 0.7, m 0.50", _CT82 + "Table I", _nonmetal(0.3, 0.50), needs_f0=True),
    "non-glare-glass": Preset(
        "sample #45, aluminised",
        _LT05 + "§5.2.1",
        _sample(_ALUMINIUM, k_dd=1.0, height_rms=0.23, correlation_length=9.9, solid_angle=5e-4, masking="off"),
    ),
    "ground-glass": Preset(
        "sample #41, aluminised",
        _LT05 + "Table 1",
        _sample(
            _ALUMINIUM, k_udf=[0.33, 0.34, 0.32], k_dd=[0.45, 0.44, 0.44], height_rms=0.86, correlation_length=4.99
        ),
    ),
    "red-paint": Preset(
        "sample #13, garnet red",
        _LT05 + "Table 2",
        _sample(
            _of_index(1.7),
            k_uds=[0.10, 0.0, 0.0],
            k_dd=[0.59, 0.72, 0.69],
            k_fs=[1.1, 1.0, 1.2],
            height_rms=0.7,
            correlation_length=8.2,
        ),
    ),
    "laser-paper": Preset(
        "sample #73",
        _LT05 + "Table 3",
        _sample(
            _of_index(1.5),
            k_uds=[0.91, 0.94, 0.83],
            k_dd=[0.28, 0.25, 0.25],
            k_fs=[1.9, 2.0, 1.7],
            height_rms=0.39,
            correlation_length=5.4,
        ),
    ),
    "rust": Preset("s 0.2, d 0.8, m 0.35", _CT82 + "Table I", _nonmetal(0.2, 0.35), needs_f0=True),
}
