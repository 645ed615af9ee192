"""Folders as laboratories publish them, read without a capture.toml: one file a layout, one line in the catalogue.

A layout finds its own files in a folder and turns them into the tables of a capture.toml; everything after that is the
same for all captures.
"""

from __future__ import annotations

from pathlib import Path

from matest.capture.formats import diligent, dome, light_list
from matest.capture.formats.layout import Content, Layout
from matest.errors import InputError

LAYOUTS: tuple[Layout, ...] = (
    diligent.LAYOUT,
    light_list.LAYOUT,
    dome.LAYOUT,
)

__all__ = ["LAYOUTS", "Content", "Layout", "recognise"]


def recognise(path: Path) -> tuple[Layout, tuple[Path, ...]] | None:
    """The layout that a folder or a file is of, and the files that it is read from; None where it is of none.

    A file that is of a layout itself comes before others that lie beside it.

    Raises:
        InputError: a folder of several captures, of several layouts, or with several lists of lights.
    """
    found = [(layout, files) for layout in LAYOUTS if (files := layout.find(path))]
    if len(found) > 1:
        lists = ", ".join(files[0].name for _, files in found)
        raise InputError(f"{path}: holds several lists of lights ({lists}); give one of them, not the folder.")
    return found[0] if found else None
