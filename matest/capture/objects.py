"""Several objects before one camera: their tables, and the mesh that is all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from matest.capture import schema
from matest.capture.schema import ObjectTable
from matest.errors import Fault
from matest.scene.mesh import Mesh

# Most objects: a map of them has 8 bits, of which 0 is the background.
_MOST = 255
# Smallest determinant of a transform relative to the cube of its scale that does not flatten a mesh.
_FLAT = 1e-6


def object_faults(tables: schema.CaptureFile) -> Iterator[Fault]:
    """What is wrong with the objects of a file, and with what stands beside them."""
    objects, scene = tables.object, isinstance(tables, schema.SceneFile)
    if not objects:
        return
    yield len(objects) > _MOST, f"a file has at most {_MOST} objects; got {len(objects)}."
    beside = tables.geometry != schema.GeometryTable()
    yield beside, "[geometry] is that of one object; put it into its [[object]], or leave out all [[object]]."
    names: set[str] = set()
    for number, table in enumerate(objects):
        unfit = not table.name.isprintable() or not table.name.strip(". ") or bool(set(table.name) & {*"/\\:"})
        yield unfit, f"object {number}: its name is also that of a folder; got {table.name!r}, choose another."
        # Disks may take no notice of case.
        yield table.name.lower() in names, f"two objects have the name '{table.name}'; give each a name of its own."
        names.add(table.name.lower())
        for wrong, sentence in _table_faults(table):
            yield wrong, f"object '{table.name}': {sentence}"
        lacks = scene and table.material is None
        yield lacks, f"object '{table.name}' has no material; add [object.material] below its [[object]]."
    common = isinstance(tables, schema.SceneFile) and tables.material is not None
    yield common, "with [[object]] tables every object has a material of its own; leave out [material]."


def _table_faults(table: ObjectTable) -> Iterator[Fault]:
    """Keys of an object that do not go together."""
    yield (table.mesh is None) == (table.shape is None), "needs one of mesh and shape."
    if table.shape is not None:
        yield table.radius is None, "a sphere needs a radius in world units, and its centre as position."
        yield table.transform is not None, "a transform is that of a mesh; a sphere has position and radius."
        return
    yield table.radius is not None, "a radius is that of shape = 'sphere'; leave it out."
    both = table.transform is not None and table.position is not None
    yield both, "transform says where the mesh is; leave out position."
    if table.transform is not None:
        matrix = np.array(table.transform)
        linear = matrix[:3, :3]
        rigid = (matrix[3] == (0, 0, 0, 1)).all() and np.linalg.det(linear) > _FLAT * np.linalg.norm(linear) ** 3
        given = [list(row) for row in table.transform]
        sentence = (
            f"transform must be 4×4, end with [0, 0, 0, 1], and neither flatten nor mirror the mesh; got {given}."
        )
        yield not rigid, sentence


def objects_mesh(objects: list[ObjectTable], locate: Callable[[str, str], Path]) -> tuple[Mesh, np.ndarray]:
    """The mesh that is all objects in the world, and the number of the object of each of its faces [F].

    Args:
        objects: their tables.
        locate: gives the file that a key refers to, by the reference and the key.

    Raises:
        InputError: a mesh cannot be read.
    """
    parts = [_part(table, locate) for table in objects]
    mesh = Mesh.together([part for part, _ in parts], [matrix for _, matrix in parts])
    counts = [len(part.faces) for part, _ in parts]
    return mesh, np.repeat(np.arange(len(parts), dtype=np.uint8), counts)


def _part(table: ObjectTable, locate: Callable[[str, str], Path]) -> tuple[Mesh, np.ndarray]:
    """The mesh of an object, and the transform [4, 4] that places it in the world."""
    matrix = np.eye(4) if table.transform is None else np.array(table.transform)
    if table.position is not None:
        matrix[:3, 3] = table.position
    if table.mesh is not None:
        return Mesh.load(locate(table.mesh, f"object '{table.name}': mesh")), matrix
    assert table.radius is not None
    matrix[:3, :3] *= table.radius
    return Mesh.sphere(), matrix
