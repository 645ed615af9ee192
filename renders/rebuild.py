"""Rebuild everything in this folder but the benchmark's pictures: `python renders/rebuild.py [CAPTURE...]`.

Meshes and the map of light are made here; every capture is rendered from its scene as `matest render` does, then the
gallery and the curves of the papers are drawn. With names only these captures. The same versions of the libraries give
the same bits.
"""

from __future__ import annotations

import sys
from pathlib import Path

import figures
import gallery
from papers import shapes
from papers.surroundings import room

from matest.photographs.images import write_image
from matest.simulate import simulate

HERE = Path(__file__).parent
MESHES = {
    "vase/vase.ply": shapes.clay_vase,
    "figure-13/vase.ply": shapes.clay_vase,
    "gallery/oren-nayar-15/vase.ply": lambda: shapes.clay_vase(40, 56),
    "gallery/oren-nayar-15/cylinder.ply": shapes.cylinder,
    "gallery/oren-nayar-15/cube.ply": shapes.cube,
    "gallery/cook-torrance-06/vase.ply": shapes.open_vase,
    "gallery/cook-torrance-07/vase.ply": shapes.open_vase,
    "gallery/cook-torrance-08/link.ply": shapes.link,
}
# The map of light of Li & Torrance's figure 3.
ROOM = "gallery/li-torrance-03/room.exr"


def main(names: list[str]) -> None:
    """Rebuild the named captures, or everything."""
    for path, shape in MESHES.items():
        (HERE / path).write_bytes(shapes.ply(shape()))
    write_image(HERE / ROOM, room())
    for scene in sorted(HERE.glob("*/scene.toml")):
        if not names or scene.parent.name in names:
            simulate(scene)
            print(scene.parent)
    if not names:
        gallery.main([])
        figures.main([])


if __name__ == "__main__":
    main(sys.argv[1:])
