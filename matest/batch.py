"""Estimates of one capture or many: a job for each, its outcome, and who does it."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import matest
from matest.capture import load_capture
from matest.capture.capture import present_digests
from matest.capture.description import object_names
from matest.cluster import SchedulerLostError, in_cluster
from matest.division import divided
from matest.errors import BAD_INPUT, NO_MEMORY, WORK_FAILED, InputError, WorkError, out_of_memory, own_fault
from matest.estimation.estimate import estimate_with
from matest.estimation.options import Options
from matest.estimation.result import Estimate, read_result
from matest.places import reserved, sweep
from matest.pool import MOST_DEATHS, Lost, in_processes, limited_memory
from matest.progress import Progress, silent
from matest.report import manifest
from matest.report.folder import check_destination, write_result
from matest.report.picture_size import PictureSize
from matest.report.summary import Row
from matest.workers import processors

# Bytes of the process that hands out the captures.
_OWN_MEMORY = 400 << 20
# Bytes that a process of one thread for a small capture needs: 411 MiB as the system counts them, most of it torch.
_LEAST_MEMORY = 450 << 20


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
        resume: whether a complete result of the same request and the same files is kept.
    """

    capture: Path
    out: Path
    options: Options
    root: Path | None = None
    command: str = ""
    pictures: PictureSize = PictureSize.PREVIEW
    object: str | None = None
    resume: bool = False

    @property
    def name(self) -> str:
        """The name of the capture, and of the object in it."""
        name = capture_name(self.capture)
        return name if self.object is None else f"{name}/{self.object}"

    @property
    def label(self) -> str:
        """The capture as it was named, and the object in it."""
        return str(self.capture) if self.object is None else f"{self.capture}: {self.object}"

    @property
    def request(self) -> dict[str, Any]:
        """What decides on the result beside the files of the capture, of plain types."""
        return {"matest": matest.__version__, "options": asdict(self.options), "pictures": self.pictures.value}


@dataclass(frozen=True)
class Outcome:
    """The result of a job.

    Attributes:
        job: that was run.
        estimate: the same as in the result folder; None where the capture cannot be used.
        error: why it cannot be used, in one sentence; empty where there is an estimate.
        failed: whether that is no fault of the capture: its result cannot be written, or memory does not suffice.
        lacks_memory: whether memory does not suffice.
    """

    job: Job
    estimate: Estimate | None = None
    error: str = ""
    failed: bool = False
    lacks_memory: bool = False

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
    resume: bool = False,
) -> list[Job]:
    """One job for each capture, also for one that is named twice, and for each object of one that shows several.

    Args:
        captures: folders or files.
        out: the result folder of a single capture, the parent folder of the results of several; None: `matest` in
            the folder of each capture. Results of several objects go to folders in it, by their names.
        options: of every estimate.
        command, pictures, resume: see `Job`.
        root: folder that files of the captures may not leave; None: their common one.

    Raises:
        InputError: two results would go to one folder.
    """
    names = [capture_name(capture) for capture in captures]
    if out is not None and len({*names}) < len(names):
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        raise InputError(f"two captures have the same name ({', '.join(twice)}); estimate them one by one.")
    # Captures of one command may share files in their common parent folder.
    if root is None:
        root = Path(os.path.commonpath([capture.absolute() for capture in captures]))
        root = root if root.is_dir() else root.parent
    places = {
        capture: _folder(capture) / "matest" if out is None else out / name if len(captures) > 1 else out
        for capture, name in zip(captures, names, strict=True)
    }
    return [
        Job(capture, place if name is None else place / name, options, root, command, pictures, name, resume)
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
        with reserved(job.out):
            capture = load_capture(job.capture, transfer=job.options.transfer, root=job.root, progress=progress)
            capture = capture.object(job.object)
            estimate = estimate_with(capture, job.options, progress)
            provenance = {
                "matest": matest.__version__,
                "capture": _path_from(job.out, job.capture),
                "root": _path_from(job.out, job.root or _folder(job.capture)),
                "inputs": capture.digests(),
                **({} if job.object is None else {"object": job.object}),
                "command": job.command,
            }
            estimate = replace(estimate, provenance=provenance)
            estimate = write_result(estimate, capture, job.out, progress, pictures=job.pictures, request=job.request)
            return Outcome(job, estimate)
    except InputError as error:
        return Outcome(job, error=str(error))
    except SchedulerLostError:
        raise
    except WorkError as error:
        return Outcome(job, error=str(error), failed=True)
    except OSError as error:
        return Outcome(job, error=f"{error.filename or job.out}: {error.strerror or error}.", failed=True)
    except Exception as error:
        # Whatever it is, other captures are estimated.
        lacks = out_of_memory(error)
        reason = NO_MEMORY if lacks else own_fault(error)
        return Outcome(job, error=f"{job.label}: {reason}", failed=True, lacks_memory=lacks)


def summarised(job: Job) -> Row:
    """Do a job, unless its result is to be kept and complete, and say what it came to."""
    if job.resume and (row := _kept(job)):
        return row
    outcome = run(job)
    if outcome.estimate is None:
        status: Literal["failed", "bad input"] = "failed" if outcome.failed else "bad input"
        return Row(job.name, status, error=outcome.error, lacks_memory=outcome.lacks_memory)
    return Row.of(job.name, outcome.estimate.to_dict())


def run_all(
    jobs: Sequence[Job], workers: int = 1, memory: int | None = None, scheduler: str | None = None
) -> Generator[tuple[Job, Row]]:
    """Every job with what it came to, as they are done.

    Args:
        jobs: any number.
        workers: processes that do them; with one, this process.
        memory: bytes that all processes together may have; None: any number.
        scheduler: address of a Dask scheduler whose workers do them, or "local"; None: processes of this machine.

    Raises:
        InputError: too little memory for anything, or nothing at that address.
        WorkError: the processes do not start, or the scheduler is lost.
    """
    try:
        if scheduler is not None:
            done = _elsewhere(jobs, scheduler)
        elif workers > 1:
            done = _side_by_side(jobs, workers, memory)
        else:
            done = _here(jobs, memory)
        for job, result in done:
            row = _row(job, result)
            yield job, replace(row, error=more_memory(job)) if row.lacks_memory and memory else row
    finally:
        # Of processes that were ended by force.
        for job in jobs:
            sweep(job.out)


def _elsewhere(jobs: Iterable[Job], scheduler: str) -> Iterator[tuple[Job, Row | Lost]]:
    """Jobs done by workers of a cluster, in whose working folders paths lead to the same files.

    Of a single one they do the passes over its samples, and this process the rest.
    """
    jobs = [*jobs]
    if len(jobs) == 1:
        with divided(scheduler):
            yield jobs[0], summarised(jobs[0])
        return
    known_by = {job.out.absolute(): job for job in jobs}
    for job, row in in_cluster(summarised, [_everywhere(job) for job in jobs], scheduler):
        yield known_by[job.out], row


def more_memory(job: Job) -> str:
    """What to say of a job that the memory which the user allows does not suffice for."""
    return f"{job.label}: needs more than --memory leaves it; give more, or fewer or smaller images."


def _here(jobs: Iterable[Job], memory: int | None) -> Iterator[tuple[Job, Row]]:
    with limited_memory(memory):
        for job in jobs:
            yield job, summarised(job)


def _side_by_side(jobs: Sequence[Job], workers: int, memory: int | None) -> Iterator[tuple[Job, Row | Lost]]:
    """Jobs done by processes that share the memory; those that need more than a share come last, one at a time."""
    if memory is None:
        yield from in_processes(summarised, jobs, workers)
        return
    free = memory - _OWN_MEMORY
    workers = min(workers, len(jobs))
    # Where memory suffices for fewer processes, it does not suffice for more threads in each either.
    threads = max(processors() // workers, 1)
    workers = min(workers, free // _LEAST_MEMORY)
    if workers < 1:
        least = math.ceil((_OWN_MEMORY + _LEAST_MEMORY) / 1e6)
        raise InputError(f"--memory {memory / 1e6:.0f}MB is too little for any capture; give {least}MB or more.")
    large = []
    for job, row in in_processes(summarised, jobs, workers, free // workers, threads):
        if workers > 1 and isinstance(row, Row) and row.lacks_memory:
            large.append(job)
        else:
            yield job, row
    yield from in_processes(summarised, large, 1, free)


def _row(job: Job, result: Row | Lost) -> Row:
    if isinstance(result, Row):
        return result
    why = f"{result.reason}, {MOST_DEATHS} times; often memory does not suffice: let fewer captures run at once."
    return Row(job.name, "failed", error=f"{job.label}: {why}")


def _everywhere(job: Job) -> Job:
    """The job with paths that lead to the same files whatever the working folder."""
    root = None if job.root is None else job.root.absolute()
    return replace(job, capture=job.capture.absolute(), out=job.out.absolute(), root=root)


def _kept(job: Job) -> Row | None:
    """The row of the complete result of a job; None where there is none of what the files are now."""
    try:
        with reserved(job.out):
            if manifest.answers(job.out, job.request, present_digests(job.capture, job.root)):
                return Row.of(job.name, read_result(job.out), kept=True)
    except (InputError, WorkError, OSError):
        # The estimate meets it again, and says so.
        pass
    return None


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
