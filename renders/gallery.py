"""Render the papers' figures and the page that shows them, `renders/README.md`: `python renders/gallery.py [NAME...]`.

Every figure has its scene in a folder of its own, which `matest render` takes as well. Metals need their optical
constants: `pip install "matest-brdf[metals]"`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from papers import cook_torrance_scenes, li_torrance_scenes, oren_nayar_scenes
from papers.drawing import Entry, publish

HERE = Path(__file__).parent
FIGURES: dict[str, Entry] = oren_nayar_scenes.FIGURES | cook_torrance_scenes.FIGURES | li_torrance_scenes.FIGURES
HEADING = """# Renders

`python renders/rebuild.py` makes everything in this folder anew: captures, bit for bit, from their scenes, the pictures
below, and the [curves of the papers](figures/README.md). Each picture lies beside its scene, which
`matest render renders/gallery/oren-nayar-14 -o out` renders by itself; the panels beside it differ in the material.
Pixels are means over 2×2 or 3×3 rays, without noise. Linear radiance times one exposure a picture, stated as the
radiance that is white, is encoded as sRGB; what is brighter is clipped. Numbers are measured in the renders, before
they are clipped and rounded.

| capture | photographs |
| --- | --- |
| [vase](vase) | a clay vase under three lights, 16 bits, with noise |
| [sphere](sphere) | a red plastic ball under six lights |
| [figure-13](figure-13) | the vase lit from the viewer and from 20° beside it |

[benchmark](benchmark) has pictures of run time and error.
"""


def main(names: list[str]) -> None:
    """Render the named figures, or all, and the page that shows them."""
    publish(FIGURES, names, HERE, "{}/figure.png", HEADING)


if __name__ == "__main__":
    main(sys.argv[1:])
