"""Files that commands write."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from matest.errors import InputError

# A folder that is made and removed where something is to be written.
_PROBE = ".matest-probe"


def keep_inputs(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Refuse to write over a file that is read, by whatever path or link.

    Args:
        outputs: files to be written.
        inputs: files that are read.

    Raises:
        InputError: a file is both.
    """
    present = [path for path in inputs if path.exists()]
    for output in outputs:
        if output.exists() and any(output.samefile(path) for path in present):
            raise InputError(f"{output}: is read and would be overwritten; write elsewhere with -o.")


def check_distinct(names: Sequence[str], label: object) -> None:
    """Refuse files of one folder of which one would replace another, or lie in it as if it were a folder.

    Args:
        names: from the folder.
        label: begins the refusal.

    Raises:
        InputError: there are such files, also on a disk that takes no notice of case.
    """
    places = [Path(os.path.normpath(name).lower()) for name in names]
    for number, (name, place) in enumerate(zip(names, places, strict=True)):
        others = places[:number] + places[number + 1 :]
        if place in others or any(place in other.parents for other in others):
            raise InputError(f"{label}: two files would be called '{name}'; give each a name of its own.")


def followed(path: Path) -> Path:
    """Where a link leads, even to nothing, so that what is written replaces no link; other paths as they are."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def check_writable(folder: Path) -> None:
    """Refuse a folder that cannot be made or written to, before there is anything to write.

    Raises:
        InputError: it, or what should be a folder above it, is a file.
        OSError: nothing can be written there; it names `folder`.
    """
    place = followed(folder).absolute()
    while not place.exists() and place != place.parent:
        place = followed(place.parent)
    if not place.is_dir():
        what = "is a file" if place == followed(folder).absolute() else f"lies in {place}, which is a file"
        raise InputError(f"{folder}: {what}; give another folder with -o.")
    try:
        _try_to_write(place)
    except OSError as error:
        raise OSError(error.errno, f"{error.strerror or error}; nothing can be written there", str(folder)) from None


def _try_to_write(folder: Path) -> None:
    """Rights alone do not tell: disks may be full, and folders of the system take no files.

    Raises:
        OSError: nothing can be written there.
    """
    probe = folder / _PROBE
    # Of a run that was killed.
    with contextlib.suppress(OSError):
        probe.rmdir()
    # There is one if another run does the same at this moment.
    with contextlib.suppress(FileExistsError):
        probe.mkdir()
    with contextlib.suppress(OSError):
        probe.rmdir()


def json_text(content: Any, **options: Any) -> str:
    """JSON, which has no NaN and no infinity: null stands for them.

    Args:
        content: of plain types.
        options: of `json.dumps`.
    """
    return json.dumps(_finite(content), allow_nan=False, **options)


def _finite(content: Any) -> Any:
    """The same with None for numbers that are not finite."""
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def write_text(path: Path, text: str) -> None:
    """Write UTF-8; bytes of file names that are no text are written as escapes."""
    path.write_bytes(text.encode("utf-8", "backslashreplace"))
