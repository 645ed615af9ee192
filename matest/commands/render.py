"""The command `matest render`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, note, print_json, progress

EXAMPLE = "matest render renders/vase/scene.toml -o vase-capture"


def render(
    scene: Annotated[Path, typer.Argument(help="A scene.toml, or its folder.")],
    out: arguments.Out = None,
    as_json: arguments.Json = False,
) -> None:
    """Render a scene to a capture.

    Writes images, mask, normals, capture.toml, and of several objects which each pixel shows, to OUT (default: the
    scene's folder).
    """
    from matest.scene_file import load_scene
    from matest.simulate import simulate

    with progress(str(scene)) as say:
        simulated = load_scene(scene)
        folder = simulate(simulated, out, say)
    if as_json:
        print_json({"out": str(folder), "notes": simulated.notes})
    else:
        for sentence in simulated.notes:
            note(sentence)
        console().print(f"Written to {folder}", soft_wrap=True)
