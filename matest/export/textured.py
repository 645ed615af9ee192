"""A material with textures on its mesh, and the folder of plain images that any program can read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from matest.brdf import Brdf
from matest.export.atlas import Atlas
from matest.export.texture import Coverage, Texture
from matest.photographs.images import write_image
from matest.places import whole_files

# The mesh of a folder of textures.
MESH = "mesh.obj"


@dataclass(frozen=True, eq=False)
class Textured:
    """A material some of whose parameters have textures.

    Attributes:
        material: with the means of what has textures.
        atlas: the mesh.
        textures: by name of the parameter, all of one size.
        coverage: how much of the mesh they have values of.
    """

    material: Brdf
    atlas: Atlas
    textures: Mapping[str, Texture]
    coverage: Coverage

    @property
    def size(self) -> int:
        """Texels a side."""
        return len(next(iter(self.textures.values())).status)

    @cached_property
    def at_texels(self) -> Brdf:
        """The material with a value at every texel of what has textures, [S·S, C]."""
        return self.material.replace({name: _rows(each.filled) for name, each in self.textures.items()})

    @property
    def seen(self) -> np.ndarray:
        """Flat indices of the texels that a view shows, ascending."""
        return np.flatnonzero(next(iter(self.textures.values())).status)


def _rows(image: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(image.reshape(-1, image.shape[2])))


def write_folder(textured: Textured, folder: Path) -> tuple[Path, ...]:
    """Write `NAME.exr`, `NAME_std.exr` [S, S, C] and `NAME_status.png` [S, S] of every texture, and the mesh.

    Raises:
        OSError: the folder cannot be written.
    """
    names: list[str] = []
    with whole_files(folder, MESH) as part:
        for name, each in textured.textures.items():
            contents = {f"{name}.exr": each.value, f"{name}_std.exr": each.std, f"{name}_status.png": each.status}
            for file, image in contents.items():
                write_image(part / file, image)
            names += contents
        textured.atlas.save(part / MESH)
    return tuple(folder / name for name in (*names, MESH))
