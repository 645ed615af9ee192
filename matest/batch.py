"""Estimates of one capture or many: a job for each, and its outcome."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import matest
from matest.capture import load_capture
from matest.capture.description import object_names
from matest.errors import BAD_INPUT, NO_MEMORY, WORK_FAILED, InputError, out_of_memory, own_fault
from matest.estimation.estimate import estimate_with
from matest.estimation.options import Options
from matest.estimation.result import Estimate
from matest.progress import Progress, silent
from matest.report.folder import check_destination, write_result
from matest.report.picture_size import PictureSize


@dataclass(frozen=True)
class Job:
    """One capture to estimate, as another process can receive it.

    Attributes:
        capture: folder or file.
        out: the result folder to write.
        options: of the estimate.
        root: folder that files of the capture may not leave; None: the capture's own.
        command: the command line that the result names as its origin.
        pictures: of the report.
        object: name of one of several objects that the capture shows; None: it shows one.
    """

    capture: Path
    out: Path
    options: Options
    root: Path | None = None
    command: str = ""
    pictures: PictureSize = PictureSize.PREVIEW
    object: str | None = None

    @property
    def label(self) -> str:
        """The capture, and the object in it."""
        return str(self.capture) if self.object is None else f"{self.capture}: {self.object}"


@dataclass(frozen=True)
class Outcome:
    """The result of a job.

    Attributes:
        job: that was run.
        estimate: the same as in the result folder; None where the capture cannot be used.
        error: why it cannot be used, in one sentence; empty where there is an estimate.
        failed: whether that is no fault of the capture: its result cannot be written, or memory does not suffice.
    """

    job: Job
    estimate: Estimate | None = None
    error: str = ""
    failed: bool = False

    @property
    def status(self) -> Literal["estimated", "bad input", "failed"]:
        if self.estimate is not None:
            return "estimated"
        return "failed" if self.failed else "bad input"

    @property
    def exit_code(self) -> int:
        """Exit code of a command with this outcome alone."""
        return {"estimated": 0, "failed": WORK_FAILED, "bad input": BAD_INPUT}[self.status]


def jobs(
    captures: Sequence[Path],
    out: Path | None,
    options: Options,
    command: str = "",
    pictures: PictureSize = PictureSize.PREVIEW,
    root: Path | None = None,
) -> list[Job]:
    """One job for each capture, also for one that is named twice, and for each object of one that shows several.

    Args:
        captures: folders or files.
        out: the result folder of a single capture, the parent folder of the results of several; None: `matest` in
            the folder of each capture. Results of several objects go to folders in it, by their names.
        options: of every estimate.
        command, pictures: see `Job`.
        root: folder that files of the captures may not leave; None: their common one.

    Raises:
        InputError: two results would go to one folder.
    """
    names = [capture_name(capture) for capture in captures]
    if out is not None and len({*names}) < len(names):
        raise InputError(f"two captures have the same name ({', '.join(sorted(names))}); estimate them one by one.")
    # Captures of one command may share files in their common parent folder.
    if root is None:
        root = Path(os.path.commonpath([capture.absolute() for capture in captures]))
        root = root if root.is_dir() else root.parent
    places = {
        capture: _folder(capture) / "matest" if out is None else out / name if len(captures) > 1 else out
        for capture, name in zip(captures, names, strict=True)
    }
    return [
        Job(capture, place if name is None else place / name, options, root, command, pictures, name)
        for capture, place in places.items()
        for name in _objects(capture)
    ]


def _objects(capture: Path) -> Sequence[str | None]:
    """Names of the objects of a capture; None for the one without name, or of a capture that cannot be read."""
    try:
        return object_names(capture) or [None]
    except InputError:
        return [None]


def run(job: Job, progress: Progress = silent) -> Outcome:
    """Estimate the capture of a job and write the result folder.

    Bad input is an outcome, not an exception, and so is a result that cannot be written: other jobs go on.
    """
    try:
        check_destination(job.out, "result.json")
        capture = load_capture(job.capture, transfer=job.options.transfer, root=job.root, progress=progress)
        capture = capture.object(job.object)
        estimate = estimate_with(capture, job.options, progress)
        provenance = {
            "matest": matest.__version__,
            "command": job.command,
            "capture": _path_from(job.out, job.capture),
            "root": _path_from(job.out, job.root or _folder(job.capture)),
            "inputs": capture.digests(),
            **({} if job.object is None else {"object": job.object}),
        }
        estimate = replace(estimate, provenance=provenance)
        return Outcome(job, write_result(estimate, capture, job.out, progress, pictures=job.pictures))
    except InputError as error:
        return Outcome(job, error=str(error))
    except OSError as error:
        return Outcome(job, error=f"{error.filename or job.out}: {error.strerror or error}.", failed=True)
    except Exception as error:
        # Whatever it is, other captures are estimated.
        reason = NO_MEMORY if out_of_memory(error) else own_fault(error)
        return Outcome(job, error=f"{job.label}: {reason}", failed=True)


def capture_name(capture: Path) -> str:
    """The name of a capture: that of its folder, even if `capture` is the file in it."""
    return os.path.basename(os.path.abspath(_folder(capture)))


def _folder(capture: Path) -> Path:
    return capture if capture.is_dir() else capture.parent


def _path_from(folder: Path, path: Path) -> str:
    """A path from a folder, so that both may move together; the whole path where no such path leads to it."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive of Windows
        return str(path.absolute())
