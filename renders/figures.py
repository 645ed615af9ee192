"""Draw the model curves of the papers' figures into `renders/figures/`: `python renders/figures.py [NAME...]`.

Each figure comes with what its paper says of it and what the curves here measure, in `figures/README.md`. The figures
of Cook & Torrance need the optical constants of copper: `pip install "matest-brdf[metals]"`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from papers import cook_torrance, li_torrance, oren_nayar, white_furnace
from papers.drawing import Entry

HERE = Path(__file__).parent / "figures"
FIGURES: dict[str, Entry] = oren_nayar.FIGURES | cook_torrance.FIGURES | li_torrance.FIGURES | white_furnace.FIGURES


def main(names: list[str]) -> None:
    """Draw the named figures, or all, and the page that shows them."""
    unknown = [name for name in names if name not in FIGURES]
    if unknown:
        sys.exit(f"no figure {', '.join(unknown)}; there are {', '.join(FIGURES)}.")
    HERE.mkdir(exist_ok=True)
    chosen = {name: entry for name, entry in FIGURES.items() if not names or name in names}
    page = ["# Figures of the papers", "", "Made by `python renders/figures.py`.", ""]
    for name, entry in chosen.items():
        drawn = entry.draw()
        drawn.save(HERE / f"{name}.png")
        page += [f"## {entry.title}", "", f"![{name}]({name}.png)", ""]
        page += [f"Published: {entry.published}", "", f"Here: {drawn.measured}", ""]
        print(f"{name}: {drawn.measured}", flush=True)
    if len(chosen) == len(FIGURES):
        (HERE / "README.md").write_text("\n".join(page), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
