"""The place of a result: one run at a time writes there, and its folder or files appear whole or not at all."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from matest.errors import WorkError
from matest.interruption import UNFINISHED
from matest.outputs import followed

# Of the C library: paths are from the working folder.
_AT_FDCWD = -100
# Of Linux: both names stay, with what they name exchanged.
_RENAME_EXCHANGE = 2


@contextlib.contextmanager
def reserved(out: Path) -> Iterator[None]:
    """The right to write a folder or file, which no other process has meanwhile; may be nested in one thread.

    What killed runs left beside it is removed. Folders above it are made; those that are empty at the end are removed
    again.

    Raises:
        WorkError: another run has it.
        OSError: its parent cannot be made or written to; it names `out`.
    """
    out = followed(out)
    # One object for each path, so that who has the right may ask for it again.
    lock = FileLock(_beside(out, "lock"), timeout=0, is_singleton=True)
    missing = [folder for folder in (out.parent, *out.parent.parents) if not folder.exists()]
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise WorkError(
            f"{out}: another run of matest is writing there; wait until it ends, or write elsewhere with -o."
        ) from None
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(out)) from None
    nested = lock.lock_counter > 1
    try:
        if not nested:
            UNFINISHED.add(Path(lock.lock_file))
            _remove_remains(out)
        yield
    finally:
        if not nested:
            # Who opened it in between finds that it has no name any more, and opens the next.
            Path(lock.lock_file).unlink(missing_ok=True)
            UNFINISHED.discard(Path(lock.lock_file))
        lock.release()
        with contextlib.suppress(OSError):
            for folder in missing:
                folder.rmdir()


@contextlib.contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """A temporary folder beside `out` that takes its place when the block ends well, and vanishes otherwise.

    Raises:
        WorkError: another run is writing there.
        OSError: nothing can be written there; it names `out`.
    """
    out = followed(out)
    with _part(out) as part:
        yield part
        _take_place(part, out)


@contextlib.contextmanager
def whole_files(folder: Path, last: str) -> Iterator[Path]:
    """A temporary folder whose files move to `folder` when the block ends well, and vanish otherwise.

    Args:
        folder: other files in it stay; it is made if there is none.
        last: the file that moves last, by which readers know that the others are there.

    Raises:
        WorkError: another run is writing that file.
        OSError: the files cannot be written; it names `folder`.
    """
    folder = followed(folder)
    try:
        with _part(folder / last) as part:
            yield part
            files = [file.relative_to(part) for file in part.rglob("*") if file.is_file()]
            for file in sorted(files, key=lambda file: file == Path(last)):
                (folder / file).parent.mkdir(parents=True, exist_ok=True)
                (part / file).replace(folder / file)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(folder)) from None


@contextlib.contextmanager
def _part(out: Path) -> Iterator[Path]:
    """A temporary folder beside what is to be written, which is reserved meanwhile."""
    with reserved(out):
        part = _beside(out, "part")
        try:
            part.mkdir()
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(out)) from None
        UNFINISHED.add(part)
        try:
            yield part
        finally:
            shutil.rmtree(part, ignore_errors=True)
            UNFINISHED.discard(part)


def whole_file(file: Path, content: bytes) -> None:
    """Write a file of which others see all or nothing; for who has reserved its folder.

    Raises:
        OSError: it cannot be written; it names `file`.
    """
    part = _beside(file, "part")
    try:
        part.write_bytes(content)
        part.replace(file)
    except BaseException as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror, str(file)) from None
        raise


def sweep(out: Path) -> None:
    """Remove what killed runs left beside a folder, unless another run is writing there."""
    if any(_beside(followed(out), what).exists() for what in ("lock", "part", "old")):
        with contextlib.suppress(WorkError, OSError), reserved(out):
            pass


def _beside(out: Path, what: str) -> Path:
    """A hidden path beside a folder; nobody else gives names that end so."""
    return out.with_name(f".{out.name}.matest-{what}")


def _take_place(part: Path, out: Path) -> None:
    """Let a folder be found as `out`; `part` may then be what `out` was before."""
    if not out.exists():
        part.replace(out)
    elif not _exchanged(part, out):
        old = _beside(out, "old")
        out.replace(old)
        try:
            part.replace(out)
        except BaseException:
            old.replace(out)
            raise
        shutil.rmtree(old, ignore_errors=True)


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two folders at once, so that both names exist at any time; False where a system or disk cannot."""
    rename = getattr(ctypes.CDLL(None), "renameat2", None) if os.name == "posix" else None
    return rename is not None and not rename(
        _AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE
    )


def _remove_remains(out: Path) -> None:
    """Remove what runs that were killed left beside a folder; what one of them had put aside comes back."""
    old = _beside(out, "old")
    if old.exists() and not out.exists():
        old.replace(out)
    for remains in (old, _beside(out, "part")):
        shutil.rmtree(remains, ignore_errors=True)
