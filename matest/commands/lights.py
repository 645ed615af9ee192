"""The command `matest lights`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from matest.commands import arguments
from matest.commands.console import console, print_json, progress
from matest.errors import InputError
from matest.outputs import keep_inputs
from matest.places import whole_files

if TYPE_CHECKING:
    from matest.lights.mirror import Mirror

EXAMPLE = "matest lights chrome -o lights.lp"


def lights(
    captures: Annotated[
        list[Path],
        typer.Argument(
            metavar="CAPTURE...",
            help="Folders with photographs of a mirror sphere, one for each light, and a mask.png or capture.toml; "
            "several show the same lights in the same order.",
        ),
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="The light list; OUT with .toml has tables for a capture.toml.")
    ] = Path("lights.lp"),
    circle: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,R",
            help="Circle of the sphere, pixels; one for each capture, or with one capture for each sphere in it. "
            "Default: the capture's, or fitted to the edge of its mask.",
            show_default=False,
        ),
    ] = None,
    fov_y: Annotated[
        float | None,
        typer.Option(
            "--fov-y",
            metavar="RAD",
            help="Vertical field of view of a perspective camera. Default: the capture's, or a distant camera.",
            show_default=False,
        ),
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(
            metavar="R",
            help="Radius of the spheres, world units: two of them then give positions of near lights.",
            show_default=False,
        ),
    ] = None,
    centre: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Where the centre of each sphere is, world units: for positions with a distant camera.",
            show_default=False,
        ),
    ] = None,
    diffuse: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Photographs of a matte grey sphere under the same lights in the same order: how strong the lights "
            "are follows from them.",
            show_default=False,
        ),
    ] = None,
    diffuse_circle: Annotated[
        str | None,
        typer.Option(
            "--diffuse-circle", metavar="X,Y,R", help="Circle of the matte sphere, pixels.", show_default=False
        ),
    ] = None,
    white: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="The same from photographs of a flat white target, which its mask.png shows; otherwise they show "
            "nothing else.",
            show_default=False,
        ),
    ] = None,
    white_normal: Annotated[
        str | None,
        typer.Option(
            "--white-normal",
            metavar="X,Y,Z",
            help="Normal of the flat target; 0,0,1 faces the camera. Default: with which the strengths differ least.",
            show_default=False,
        ),
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="LIST",
            help="Another list of the same lights (.lp, light_directions.txt, capture.toml): how far it is from those "
            "found.",
            show_default=False,
        ),
    ] = None,
    transfer: arguments.Transfer = None,
    as_json: arguments.Json = False,
) -> None:
    """Find the directions of lights, or their positions, from photographs of mirror spheres.

    Every direction comes with its error, from those of the sphere's outline and of the highlight; so do solid angles,
    where the highlight resolves them, and strengths, from photographs of a matte sphere or a white target. The list and
    the tables with the lights and their uncertainty go to OUT and OUT with .toml.
    """
    import numpy as np

    from matest.capture.listed_lights import load_listed_lights
    from matest.capture.mirrors import load_mirror
    from matest.lights.comparison import compare
    from matest.lights.files import check_tables, write_capture_tables, write_light_list
    from matest.lights.lights import find_lights
    from matest.lights.position import Placement
    from matest.lights.strengths import measure
    from matest.lights.white import measure_white
    from matest.report.lights import lights_record, lights_report

    if out.suffix.lower() == ".toml" or out.is_dir() or not out.absolute().parent.is_dir():
        raise InputError(
            f"{out}: expected the name of a light list, as lights.lp, in a folder that exists; make it, or give "
            "another with -o."
        )
    if white_normal and white is None:
        raise InputError("--white-normal is that of --white FOLDER, the photographs of a flat target; give both.")
    normal = arguments.normal(white_normal) if white_normal else None
    tables = out.with_suffix(".toml")
    circles = [arguments.circle(text) for text in circle or []]
    if circles and len(captures) > 1 and len(circles) != len(captures):
        raise InputError(f"--circle: expected {len(captures)}, one for each capture; got {len(circles)}.")
    shares = [circles] if len(captures) == 1 else [[one] for one in circles] or [[] for _ in captures]
    if centre and radius is None:
        raise InputError("--centre needs --radius, the radius of the spheres in world units; give both.")
    mirrors = [
        load_mirror(capture, share, transfer=arguments.encoding(transfer), fov_y=fov_y)
        for capture, share in zip(captures, shares, strict=True)
    ]
    matte, target = _strength_targets(diffuse, diffuse_circle, white, transfer, fov_y)
    listed = None if against is None else load_listed_lights(against)
    placement = None
    if radius is not None:
        centres = np.array([arguments.centre(text) for text in centre]) if centre else None
        placement = Placement(radius, centres)
        placement.check([sphere for mirror in mirrors for sphere in mirror.spheres])
    read = [*mirrors, *(each for each in (matte, target) if each is not None)]
    files = [file for mirror in read for file in (*mirror.files, mirror.folder / "capture.toml")]
    keep_inputs((out, tables), [*files, *([] if listed is None else [listed.file])])
    check_tables(tables)
    if out.exists() and not tables.exists():
        raise InputError(f"{out}: exists, and is not from an earlier run, which has tables beside it; give another -o.")
    with progress(", ".join(map(str, captures))) as say:
        found = find_lights(mirrors, placement, say)
        comparison = None if listed is None else compare(found, listed)
        strengths = None if matte is None else measure(found, matte, placement, say)
        if target is not None:
            strengths = measure_white(found, target, normal, say)
    with whole_files(out.absolute().parent, out.name) as folder:
        write_capture_tables(found, folder / tables.name, strengths)
        write_light_list(found, folder / out.name)
    if as_json:
        print_json({**lights_record(found, mirrors, strengths, comparison), "files": [str(out), str(tables)]})
        return
    console().print(lights_report(found, mirrors, strengths, comparison), f"Written to {out} and {tables}")


def _strength_targets(
    diffuse: Path | None, diffuse_circle: str | None, white: Path | None, transfer: str | None, fov_y: float | None
) -> tuple[Mirror | None, Mirror | None]:
    """Photographs of the matte sphere, and those of the flat target, one of them at most.

    Raises:
        InputError: options that do not go together, or files that cannot be used.
    """
    from matest.capture.mirrors import load_mirror, load_target

    if diffuse_circle and diffuse is None:
        raise InputError("--diffuse-circle is that of --diffuse FOLDER, the photographs of a matte sphere; give both.")
    if white is not None and diffuse is not None:
        raise InputError("--white and --diffuse both measure how strong the lights are; give one of them.")
    encoding = arguments.encoding(transfer)
    stated = [arguments.circle(diffuse_circle)] if diffuse_circle else []
    matte = None if diffuse is None else load_mirror(diffuse, stated, transfer=encoding, fov_y=fov_y)
    return matte, None if white is None else load_target(white, transfer=encoding)
