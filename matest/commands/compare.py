"""The command `matest compare`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from matest.commands import arguments
from matest.commands.console import console, print_json
from matest.errors import InputError
from matest.outputs import check_writable, keep_inputs

# First column of the table, by which an earlier one is known.
_FIRST_COLUMN = "distance"

EXAMPLE = "matest compare truth/00.exr oren-nayar/00.exr lambert/00.exr --row 128 -o figure-13"


def compare(
    images: Annotated[list[Path], typer.Argument(metavar="A B...", help="Images; the first is the reference.")],
    row: Annotated[int | None, typer.Option(help="Along this row (default: the middle one).")] = None,
    column: Annotated[int | None, typer.Option(help="Along this column.")] = None,
    line: Annotated[str | None, typer.Option(metavar="X0,Y0,X1,Y1", help="Along this line, pixel indices.")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Stem of the plot OUT.png and the table OUT.csv.")] = Path(
        "compare"
    ),
    as_json: arguments.Json = False,
) -> None:
    """Compare images along a cross-section.

    Prints rms and maximum difference in brightness from the first image; writes a plot and a CSV file. Floats count as
    they are, integers as fractions of full scale: radiance that a capture stores with a scale is not brought back.
    """
    from matest import profiles
    from matest.photographs.images import read_image
    from matest.report.pictures import write_columns
    from matest.report.plots import plot_profiles

    if len(images) < 2:
        raise InputError("compare needs two images or more; the first is the reference.")
    stem = out.with_suffix("") if out.suffix in (".png", ".csv") else out
    plot, table = Path(f"{stem}.png"), Path(f"{stem}.csv")
    keep_inputs((plot, table), images)
    _keep_others(plot, table)
    check_writable(out.parent)
    stored = [read_image(path) for path in images]
    pixels = [_as_fractions(image) for image in stored]
    height, width = pixels[0].shape[:2]
    section = profiles.middle_row((height, width))
    if sum(option is not None for option in (row, column, line)) > 1:
        raise InputError("give one of --row, --column and --line.")
    if row is not None:
        section = (0.0, float(row), width - 1.0, float(row))
    elif column is not None:
        section = (float(column), 0.0, float(column), height - 1.0)
    elif line is not None:
        section = arguments.line(line)
    comparison = profiles.compare(pixels, _distinct(images), section)
    notes = list(_scale_notes(stored, pixels, comparison.names))
    out.parent.mkdir(parents=True, exist_ok=True)
    plot_profiles(comparison, plot)
    curves = zip(comparison.names, comparison.profiles, strict=True)
    write_columns(table, {_FIRST_COLUMN: comparison.distance, **dict(curves)})
    if as_json:
        figures = zip(comparison.names, comparison.rms, comparison.maximum, comparison.peak, strict=True)
        rows = [{"image": n, "rms": r, "maximum": m, "peak": p} for n, r, m, p in figures]
        print_json({"plot": str(plot), "csv": str(table), "images": rows, "notes": notes})
        return
    from matest.report.tables import comparison_table

    console().print(comparison_table(comparison, notes), f"Written to {plot} and {table}")


def _keep_others(plot: Path, table: Path) -> None:
    """Refuse to write over files that are not those of an earlier comparison, which its table shows.

    Raises:
        InputError: there is such a file.
    """
    for path in (plot, table):
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise InputError(f"{path}: is no file that may be replaced; write elsewhere with -o.")
    if table.is_file():
        with table.open("rb") as file:
            earlier = file.read(len(_FIRST_COLUMN)) == _FIRST_COLUMN.encode()
    else:
        earlier = False
    for path in (plot, table):
        if path.exists() and not earlier:
            raise InputError(f"{path}: exists and is not from an earlier comparison; write elsewhere with -o.")


def _as_fractions(image: Any) -> Any:
    """Pixel values as floats: integers as fractions of full scale, floats as stored."""
    import numpy as np

    from matest.photographs.images import full_scale

    return image.astype(np.float64) / full_scale(image.dtype)


def _scale_notes(stored: Sequence[Any], pixels: Sequence[Any], names: Sequence[str]) -> Iterator[str]:
    """Sentences on the scales of integers and floats that are compared, one for each image unlike the first."""
    from matest.profiles import ratio_of_bright

    for image, fractions, name in zip(stored, pixels, names, strict=True):
        if (image.dtype.kind == "u") == (stored[0].dtype.kind == "u"):
            continue
        ratio = ratio_of_bright(fractions, pixels[0])
        measure = f" Where both are bright, the median of {name} is {ratio:.3g} times the other's." if ratio else ""
        integers, floats = (name, names[0]) if image.dtype.kind == "u" else (names[0], name)
        yield (
            f"{integers} holds integers, fractions of full scale, and {floats} floats, such as radiance: they differ "
            f"by the scale and the transfer of the codes too.{measure}"
        )


def _distinct(paths: list[Path]) -> list[str]:
    """The shortest ends of some paths that differ from each other, as text; the whole paths where none do."""
    for depth in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            break
    else:
        names = [str(path) for path in paths]
    # Bytes that are no text can be neither drawn nor written.
    return [os.fsencode(name).decode("utf-8", "backslashreplace") for name in names]
