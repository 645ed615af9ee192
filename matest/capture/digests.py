"""Digests of the files of a capture: of the bytes that were read, not of those that lie there later."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from matest.capture.formats.folder import is_file
from matest.errors import InputError


def digest(path: Path) -> str:
    """The SHA-256 of a file.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return "sha256:" + hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def digested(paths: Iterable[Path], digests: dict[Path, str]) -> Iterator[None]:
    """Add the SHA-256 of some files that the block reads to `digests`, except of those that do not exist.

    Raises:
        InputError: a file changed meanwhile.
    """
    before = {path: _version(path) for path in paths if is_file(path)}
    yield
    for path, version in before.items():
        digests[path] = digest(path)
        if _version(path) != version:
            raise InputError(
                f"{path}: expected a file that stays as it is while it is read, but something wrote to it; wait until "
                "it is complete and run again."
            )


def _version(path: Path) -> tuple[int, ...]:
    """Numbers that change when a file is written or replaced."""
    state = path.stat()
    return state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns
