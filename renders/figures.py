"""Draw the model curves of the papers' figures into `renders/figures/`: `python renders/figures.py [NAME...]`.

Each figure comes with what its paper says of it and what the curves here measure, in `figures/README.md`. The figures
of Cook & Torrance need the optical constants of copper: `pip install "matest-brdf[metals]"`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from papers import cook_torrance, li_torrance, li_torrance_samples, oren_nayar, white_furnace
from papers.drawing import Entry, publish

HERE = Path(__file__).parent / "figures"
FIGURES: dict[str, Entry] = (
    oren_nayar.FIGURES
    | cook_torrance.FIGURES
    | li_torrance.FIGURES
    | li_torrance_samples.FIGURES
    | white_furnace.FIGURES
)
HEADING = """# Figures of the papers

Made by `python renders/figures.py`.
"""


def main(names: list[str]) -> None:
    """Draw the named figures, or all, and the page that shows them."""
    publish(FIGURES, names, HERE, "{}.png", HEADING)


if __name__ == "__main__":
    main(sys.argv[1:])
