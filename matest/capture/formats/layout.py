"""What a layout is: how to recognise it, and what it says in the terms of a capture.toml."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from matest.capture.schema import CaptureFile


@dataclass(frozen=True)
class Content:
    """A folder in the terms of a capture.toml.

    Attributes:
        tables: as a capture.toml would state them.
        axes: of lights and normals, as the layout defines them: a clause.
        assumptions: what the layout takes for granted and the files do not say, as clauses.
        notes: what was unusual about the files and how it was read, as sentences.
        open_causes: mistakes (by the names of `photographs.alternatives`) that files of this layout are known to
            differ in: the photographs decide.
    """

    tables: CaptureFile
    axes: str
    assumptions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    open_causes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """A way to lay out a folder.

    Attributes:
        name: as its users call it.
        signs: the files that it is recognised by, for a person.
        find: the files that a folder, or one of these files, is read from, the one that errors name first; empty
            where the folder is of another layout.
        read: the content of these files.
    """

    name: str
    signs: str
    find: Callable[[Path], tuple[Path, ...]]
    read: Callable[[tuple[Path, ...]], Content]
