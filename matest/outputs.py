"""Files that commands write."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from matest.errors import InputError


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


@contextlib.contextmanager
def whole_files(folder: Path, last: str) -> Iterator[Path]:
    """A temporary folder whose files move to `folder` when the block ends well, and vanish otherwise.

    Args:
        folder: other files in it stay; it is made if there is none.
        last: the file that moves last, by which readers know that the others are there.

    Raises:
        OSError: the files cannot be written; it names `folder`.
    """
    new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".part-", dir=folder))
        try:
            yield temporary
            files = [file.relative_to(temporary) for file in temporary.rglob("*") if file.is_file()]
            for file in sorted(files, key=lambda file: file == Path(last)):
                (folder / file).parent.mkdir(parents=True, exist_ok=True)
                os.replace(temporary / file, folder / file)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            if new:
                with contextlib.suppress(OSError):
                    folder.rmdir()
            raise
        shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(folder)) from None
