"""glTF's images of a material with textures: base colour in sRGB, and roughness where a slope has a texture.

With roughness, weight and colour of the highlight as they were fitted to the material at its means, f is linear in the
base colour, channel by channel: the best one is found for some values between the smallest and the largest of a
parameter's texture, and between them interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from matest.directions import Directions
from matest.estimators.calibrated import body_albedos
from matest.export.conversion import ConversionError, Values, measured_error, pairs
from matest.export.textured import Textured
from matest.photographs.photometry import Encoding, srgb

# Values of a parameter that are converted each; colours and slopes are smooth functions of it.
_STEPS = 17
# Pairs of directions that a base colour is fitted to.
_PAIRS = 2_500
# Texels whose error is measured.
_JUDGED = 16
# Pairs of directions of each.
_JUDGED_PAIRS = 5_000
_SRGB = Encoding("srgb")
# f [n, 3] of values at directions.
Reflectance = Callable[[Values, Directions], Tensor]


@dataclass(frozen=True, eq=False)
class GltfTextures:
    """Images in place of some of a glTF material's factors.

    Attributes:
        base: base colour [S, S, 3], codes of sRGB; None: one for all.
        roughness: roughness in G, metalness in B [S, S, 3], linear codes; None: one for all.
        error: of the conversion, over some texels.
        left: parameters that have a texture and travel as their mean.
        clipped: share of the values of the base colour that exceed 1.
    """

    base: np.ndarray | None
    roughness: np.ndarray | None
    error: ConversionError
    left: tuple[str, ...]
    clipped: float

    @property
    def images(self) -> dict[str, np.ndarray]:
        """The images by glTF's names."""
        named = {"baseColorTexture": self.base, "metallicRoughnessTexture": self.roughness}
        return {name: image for name, image in named.items() if image is not None}

    @property
    def notes(self) -> list[str]:
        """Sentences on what did not come through."""
        notes = ["The error is that of some texels, rounded to 8 bits."]
        if self.left:
            notes.append(f"glTF's material has no texture for {', '.join(self.left)}: the mean was written.")
        if self.clipped:
            notes.append(f"{self.clipped:.1%} of the base colours exceed 1, which glTF does not have; they are 1.")
        return notes

    @property
    def factors(self) -> dict[str, Any]:
        """What factors become beside the images."""
        factors: dict[str, Any] = {} if self.base is None else {"baseColorFactor": [1.0, 1.0, 1.0, 1.0]}
        return factors if self.roughness is None else factors | {"metallicFactor": 1.0, "roughnessFactor": 1.0}


def textures_of(textured: Textured, values: Values, reflectance: Reflectance) -> GltfTextures:
    """The images of a material with textures.

    Args:
        textured: the material.
        values: of glTF's material, fitted at the means.
        reflectance: of glTF.
    """
    names = list(textured.textures)
    colours = [name for name in names if name in body_albedos(textured.material)]
    # A body's albedo or, of what has no body, the amplitude of its metal.
    if not colours and "weight" not in values:
        colours = [name for name in names if name in textured.material.structure.amplitudes][:1]
    slopes = [name for name in names if name.rpartition(".")[2] == "slope"][:1]
    base, clipped = (None, 0.0) if not colours else _base(textured, colours[0], values, reflectance)
    roughness = _roughness(textured, slopes[0], values) if slopes else None
    found = GltfTextures(base, roughness, ConversionError(0.0, 0.0), (), clipped)
    left = tuple(name for name in names if name not in (*colours[:1], *slopes))
    return replace(found, left=left, error=_error(textured, values, reflectance, found))


def _base(textured: Textured, name: str, values: Values, reflectance: Reflectance) -> tuple[np.ndarray, float]:
    """Base colours of a parameter's texture, and the share of them that is clipped."""
    sample = pairs(_PAIRS, seed=1)
    directions, weight = Directions(sample.wi, sample.wo), sample.weight * sample.wi[:, 2:].square()
    zero, one = (torch.full((3,), value, dtype=torch.float64) for value in (0.0, 1.0))
    offset = reflectance({**values, "base": zero}, directions).expand(-1, 3)
    slope = reflectance({**values, "base": one}, directions).expand(-1, 3) - offset
    filled = textured.textures[name].filled
    steps = np.linspace(filled.min(), filled.max(), _STEPS)
    with torch.no_grad():
        best = torch.stack([
            (weight * slope * (_material_at(textured, name, float(step))(sample.wi, sample.wo).expand(-1, 3) - offset))
            .sum(0) / (weight * slope.square()).sum(0)
            for step in steps
        ]).numpy()  # fmt: skip
    colour = np.stack(
        [np.interp(filled[..., channel % filled.shape[2]], steps, best[:, channel]) for channel in range(3)], axis=-1
    )
    clipped = float((colour.reshape(-1, 3)[textured.seen] > 1).mean())
    return srgb(colour), clipped


def _material_at(textured: Textured, name: str, value: float) -> Any:
    """The material with one value of a parameter in all channels, and the means of the others."""
    shape = textured.textures[name].mean.shape
    return textured.material.replace({name: torch.full(shape, value, dtype=torch.float64)})


def _roughness(textured: Textured, name: str, values: Values) -> np.ndarray:
    """Roughness √α and metalness of a slope's texture: α grows with the slope, by the factor fitted at its mean."""
    factor = float(values["alpha"]) / float(textured.textures[name].mean.mean())
    alpha = (factor * textured.textures[name].filled.mean(axis=2)).clip(0, 1)
    metal = np.full_like(alpha, 0.0 if "weight" in values else 1.0)
    return np.round(255 * np.stack([np.zeros_like(alpha), np.sqrt(alpha), metal], axis=-1)).astype(np.uint8)


def _error(textured: Textured, values: Values, reflectance: Reflectance, found: GltfTextures) -> ConversionError:
    """The rms and the median of the errors of some texels that are seen."""
    seen = textured.seen
    places = np.random.default_rng(0).choice(seen, min(_JUDGED, len(seen)), replace=False)
    errors, sample = [], pairs(_JUDGED_PAIRS)
    for place in places:
        row, column = divmod(int(place), textured.size)
        material = textured.material.replace(
            {name: torch.from_numpy(each.value[row, column]).double() for name, each in textured.textures.items()}
        )
        own = dict(values)
        if found.base is not None:
            own["base"] = torch.from_numpy(_SRGB.linear(found.base[row, column] / 255.0))
        if found.roughness is not None:
            own["alpha"] = torch.tensor((found.roughness[row, column, 1] / 255.0) ** 2, dtype=torch.float64)
        errors.append(measured_error(material, _evaluated(reflectance, own), sample))
    return ConversionError(
        math.sqrt(float(np.mean([error.relative_rmse**2 for error in errors]))),
        float(np.median([error.median for error in errors])),
    )


def _evaluated(reflectance: Reflectance, values: Values) -> Callable[[Tensor, Tensor], Tensor]:
    return lambda wi, wo: reflectance(values, Directions(wi, wo))
