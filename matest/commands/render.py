"""The command `matest render`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from matest.commands import arguments
from matest.commands.console import print_json, progress

EXAMPLE = "matest render renders/vase/scene.toml -o vase-capture"


def render(
    scene: Annotated[Path, typer.Argument(help="A scene.toml, or its folder.")],
    out: arguments.Out = None,
    as_json: arguments.Json = False,
) -> None:
    """Render a scene to a capture.

    Writes images, mask, normals and capture.toml to OUT (default: the scene's folder).
    """
    from matest.simulate import simulate

    with progress(str(scene)) as say:
        folder = simulate(scene, out, say)
    if as_json:
        print_json({"out": str(folder)})
    else:
        typer.echo(f"Written to {folder}")
