"""Results with maps, put together on the mesh that their captures show."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from matest.brdf import Brdf
from matest.capture.viewpoint import load_viewpoint
from matest.errors import InputError
from matest.estimation.result import load_material, material_is_relative, read_result
from matest.export.atlas import atlas_of
from matest.export.texture import View, merged, texture_size
from matest.export.textured import Textured
from matest.parameters import Role
from matest.progress import Progress
from matest.report.maps import load_maps, map_shape
from matest.scene.mesh import Mesh

# Largest distance of the vertices of one mesh in two files, share of its extent.
_ONE_MESH = 1e-5


@dataclass(frozen=True, eq=False)
class Merged:
    """Results with maps, put together on their mesh.

    Attributes:
        textured: their material.
        notes: sentences on how it came about.
        files: of the captures, that must not be written over.
    """

    textured: Textured
    notes: list[str]
    files: list[Path]


@dataclass(frozen=True, eq=False)
class _Result:
    """A result with maps, the mesh that it is of, and the files of its capture."""

    folder: Path
    material: Brdf
    content: Mapping[str, Any]
    view: View
    mesh: Mesh
    files: tuple[Path, ...]


def merge_results(results: Sequence[Path], size: int | None, progress: Progress) -> Merged:
    """The material of one result or several views with textures.

    Args:
        results: result folders; where lights of one have no known strength, the others give its scale.
        size: texels a side; None: a texel is about as wide as a pixel of the sharpest view.
        progress: called with a word on what is being done.

    Raises:
        InputError: a result without maps, a capture that is gone or has no mesh, views of several meshes or models.
    """
    folders = [result if result.is_dir() else result.parent for result in results]
    progress("reading maps")
    views = [_read(folder) for folder in folders]
    # Those that know their scale come first.
    views.sort(key=lambda one: one.view.relative)
    for one in views[1:]:
        _check_alike(views[0], one)
    progress("unwrapping")
    atlas = atlas_of(views[0].mesh, str(views[0].folder))
    size = size or texture_size(atlas, [one.view for one in views])
    progress("merging views")
    material = views[0].material
    scalable = frozenset(material.structure.scales)
    textures, coverage, scales = merged(atlas, [one.view for one in views], size, scalable)
    if not coverage.seen:
        raise InputError(f"{views[0].folder}: its maps have no value on the mesh; estimate with --maps again.")
    values = _in_common(views, [scale if np.isfinite(scale) else 1.0 for scale in scales])
    means = {name: torch.from_numpy(each.mean).double() for name, each in textures.items()}
    notes = [f"The maps cover {coverage.seen:.0%} of the surface with {size}×{size} texels; {atlas.origin}."]
    if coverage.difference is not None:
        notes.append(
            f"{coverage.repeated:.0%} of it lie in several views, which differ by {coverage.difference:.1f} standard "
            "errors in the median."
        )
    notes += [
        f"{one.folder} shares no part of the surface with the results before it, and its scale is unknown: it may be "
        "too bright or too dark beside them."
        for one, scale in zip(views, scales, strict=True)
        if not np.isfinite(scale)
    ]
    material = material.replace({**values, **means})
    files = [file for one in views for file in one.files]
    return Merged(Textured(material, atlas, textures, coverage), notes, files)


def _read(folder: Path) -> _Result:
    """A result with maps, and mesh and camera of its capture.

    Raises:
        InputError: it has no maps, or its capture is gone, has no mesh, or is not what it was.
    """
    material, shape, content = load_material(folder), map_shape(folder), read_result(folder)
    stated, root = (content["provenance"].get(key) for key in ("capture", "root"))
    # Results are written into the folder of their capture unless -o says otherwise.
    capture = _place(folder, stated or "..")
    if not capture.exists() or (stated is None and not (capture / "capture.toml").is_file()):
        raise InputError(
            f"{folder}: its capture, which has the mesh and the camera, is not at {capture}; put it there or estimate "
            "it again."
        )
    viewpoint = load_viewpoint(capture, shape, root=None if root is None else _place(folder, root))
    maps = load_maps(folder, viewpoint.surface)
    view = View(viewpoint.surface, viewpoint.camera, maps, material_is_relative(folder))
    return _Result(folder, material, content, view, viewpoint.mesh, viewpoint.files)


def _place(folder: Path, stated: object) -> Path:
    """A path that a result folder states from itself."""
    return Path(os.path.normpath(folder.absolute() / str(stated)))


def _check_alike(first: _Result, other: _Result) -> None:
    """Refuse results that are not views of one object and material.

    Raises:
        InputError: they are not.
    """
    names = [f"{one.material.expression} with maps of {', '.join(one.view.maps)}" for one in (first, other)]
    if names[0] != names[1]:
        raise InputError(
            f"{other.folder}: has {names[1]}, but {first.folder} has {names[0]}; views that are merged have one model "
            "and the same maps."
        )
    channels = [[each.value.shape[1] for each in one.view.maps.values()] for one in (first, other)]
    meshes = first.mesh, other.mesh
    alike = meshes[0].faces.shape == meshes[1].faces.shape and bool((meshes[0].faces == meshes[1].faces).all())
    if alike:
        apart = float(np.abs(meshes[0].vertices - meshes[1].vertices).max())
        alike = apart <= _ONE_MESH * meshes[0].extent
    if not alike or channels[0] != channels[1]:
        what = "the channels" if alike else "the mesh"
        raise InputError(
            f"{other.folder}: has not {what} of {first.folder}; views that are merged show one mesh, which stays where "
            "it is while the camera moves, in images of one kind."
        )


def _in_common(views: Sequence[_Result], scales: Sequence[float]) -> dict[str, Tensor]:
    """Values of what has no map: the mean of the views, weighted by 1/std² where all state it.

    What goes with the scale of the first view is that of the first.
    """
    material = views[0].material
    values = {}
    for name in material.parameters.keys() - views[0].view.maps.keys():
        if material.declared[name].role is Role.GAUGE:
            continue
        factors = scales if name in material.structure.scales else [1.0] * len(views)
        each = torch.stack([factor * one.material.parameters[name] for one, factor in zip(views, factors, strict=True)])
        errors = [one.content["parameters"].get(name, {}).get("std") for one in views]
        weight = torch.ones_like(each)
        if None not in errors and all(np.all(np.asarray(error, dtype=float) > 0) for error in errors):
            std = torch.stack([
                factor * torch.as_tensor(error, dtype=each.dtype).expand_as(each[0])
                for error, factor in zip(errors, factors, strict=True)
            ])  # fmt: skip
            weight = std.square().reciprocal()
        values[name] = (weight * each).sum(0) / weight.sum(0)
    return values
