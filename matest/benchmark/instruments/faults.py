"""Faults that are really caused: processes killed, disks full, files that vanish; each yields what it spoilt."""

from __future__ import annotations

import contextlib
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from matest.benchmark.instruments.laboratory import (
    HANGS,
    PIPES,
    Laboratory,
    children,
    ended,
    ended_in_words,
    good,
    locked,
    until,
    unworded,
)
from matest.capture.digests import digest
from matest.report import manifest

# Seconds in which a command that is asked to end has to.
PROMPT = 2.0
# Bytes of a page, in which small disks are counted, and how many are free: from none to what a result takes.
_PAGE = 4096
_PAGES_LEFT = (0, 12)
# Bytes of the largest file: from less than any to more than the report has.
_FULL = (100, 40_000)
# Bytes of address space that suffice to start, and at the upper end for a capture.
_SCANT = (1_000 << 20, 1_250 << 20)
# Exit codes of a process that OpenBLAS ended, or the loader of libraries.
_ENDED_BY_LIBRARIES = (1, 127)
# What a command says that was interrupted.
_COUNT = re.compile(r"interrupted; (\d+) of \d+ captures are complete")


def killed(lab: Laboratory) -> Iterator[str]:
    """Kill -9 of a command, over earlier results or not; then --resume."""
    processes, earlier = lab.moments.choice([1, 2]), lab.moments.random() < 0.5
    lab.restart(earlier)
    process = lab.started("--jobs", processes)
    lab.wait_in_work(processes)
    process.kill()
    ended(process)
    # Processes of a pool end by themselves.
    until(lambda: not locked(lab.out))
    yield from lab.lost(all_of_them=earlier, over=False)
    yield from lab.resumed()


def process_killed(lab: Laboratory) -> Iterator[str]:
    """Kill -9 of one of two processes: the command goes on, and misses nothing."""
    lab.restart()
    process = lab.started("--jobs", 2)
    lab.wait_in_work(2)
    for child in children(process.pid)[:1]:
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
    yield from good(process)
    yield from lab.lost()


def interrupted(kind: int, *options: str) -> Callable[[Laboratory], Iterator[str]]:
    """A signal that asks to end: at once, with the number of complete results."""

    def cause(lab: Laboratory) -> Iterator[str]:
        processes = lab.moments.choice([1, 2])
        lab.restart()
        process = lab.started(*(options or ("--jobs", processes)))
        lab.wait_in_work(processes)
        begin = time.monotonic()
        process.send_signal(kind)
        code, _, errors = ended(process)
        if code == 0:  # it was done before
            yield from lab.lost()
            return
        lab.ends.append(time.monotonic() - begin)
        if lab.ends[-1] > PROMPT:
            yield f"ended after {lab.ends[-1]:.1f} s"
        told = _COUNT.search(errors)
        if code != 1 or told is None or int(told[1]) > len(lab.complete()):
            yield f"ended with {code}: {errors}; {len(lab.complete())} are complete"
        yield from lab.lost(all_of_them=False)

    return cause


class ImpossibleHereError(Exception):
    """A fault that cannot be caused on this machine. Its text says why."""


def disk_full(lab: Laboratory) -> Iterator[str]:
    """A disk that is full after some files more than the earlier results, which stay where no new ones can be written.

    Raises:
        ImpossibleHereError: this process may not mount a disk.
    """
    lab.restart(earlier=True)
    pages = sum(-(-path.stat().st_size // _PAGE) + 1 for path in lab.out.rglob("*"))
    lab.restart()
    lab.out.mkdir()
    size = f"size={_PAGE * (pages + lab.moments.randint(*_PAGES_LEFT))}"
    if subprocess.run(["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(lab.out)], check=False, **PIPES).returncode:
        raise ImpossibleHereError("this process may not mount a small disk")
    try:
        shutil.copytree(lab.folder / "earlier", lab.out, dirs_exist_ok=True)
        process = lab.started()
        yield from ended_in_words(process, (0, 1))
        yield from lab.lost()
    finally:
        subprocess.run(["umount", str(lab.out)], check=False)


def files_limited(lab: Laboratory) -> Iterator[str]:
    """No file may grow beyond a random size, over earlier results: they stay where no new ones can be written."""
    lab.restart(earlier=True)
    process = lab.started(limits={resource.RLIMIT_FSIZE: lab.moments.randint(*_FULL)})
    yield from ended_in_words(process, (0, 1))
    yield from lab.lost()


def memory_scant(lab: Laboratory) -> Iterator[str]:
    """Too little address space, from just enough to start; then --resume with enough.

    The loader of libraries and OpenBLAS end the process where they find no memory for themselves: then nothing that
    runs in it can say a word, or remove its lock, as after a kill.
    """
    lab.restart(earlier=True)
    process = lab.started(limits={resource.RLIMIT_AS: lab.moments.randint(*_SCANT)})
    code, _, errors = ended(process)
    by_itself = bool(errors) or not code
    if by_itself:
        yield from unworded(code, errors, (0, 1))
    elif code not in _ENDED_BY_LIBRARIES:
        yield f"ended with {code}, without a word"
    yield from lab.lost(over=by_itself)
    yield from lab.resumed()


def photograph_gone(lab: Laboratory) -> Iterator[str]:
    """A photograph is deleted while captures are read."""
    lab.restart()
    victim = lab.moments.choice(lab.captures)
    with _spared(victim):
        process = lab.started()
        lab.wait_in_work(1)
        (victim / "01.png").unlink()
        yield from ended_in_words(process, (0, 1, 2), victim.name)
        missing = {*lab.answers} - {*lab.complete()}
        if missing - {victim.name}:
            yield f"no result of {', '.join(missing)}"
        yield from lab.lost(all_of_them=False)
    yield from lab.resumed()


def photograph_changed(lab: Laboratory) -> Iterator[str]:
    """A photograph is written over and over while captures are read: a result is of one version, and says which."""
    lab.restart()
    victim = lab.moments.choice(lab.captures)
    with _spared(victim):
        versions = [(victim / name).read_bytes() for name in ("01.png", "02.png")]
        known = [digest(victim / name) for name in ("01.png", "02.png")]
        stop = threading.Event()

        def write() -> None:
            while not stop.wait(lab.moments.uniform(0, 0.02)):
                (victim / "01.png").write_bytes(lab.moments.choice(versions))

        writer = threading.Thread(target=write)
        process = lab.started()
        writer.start()
        yield from ended_in_words(process, (0, 1, 2), victim.name)
        stop.set()
        writer.join()
        if victim.name in lab.complete():
            read = manifest.inputs_of(lab.out / victim.name)["01.png"]
            if read not in known:
                yield "a result of bytes that no version has"
            if read != known[0]:
                # Right, of other bytes than those of the reference.
                shutil.rmtree(lab.out / victim.name)
        yield from lab.lost(all_of_them=False)
    yield from lab.resumed()


def output_refused(lab: Laboratory) -> Iterator[str]:
    """A place below a file, or that the system keeps for itself."""
    (lab.folder / "file").write_text("mine", "utf-8")
    place = lab.moments.choice([lab.folder / "file" / "out", Path("/proc/matest/out")])
    process = subprocess.Popen([*lab.command(), "-o", str(place)], **PIPES)
    yield from ended_in_words(process, (1, 2))
    if (lab.folder / "file").read_text("utf-8") != "mine":
        yield "the file was written over"


def two_runs(lab: Laboratory) -> Iterator[str]:
    """Two commands on one output at once: one of them says so, or finds the other done."""
    lab.restart()
    first = lab.started()
    second = subprocess.Popen(lab.command(), **PIPES)
    yield from good(first)
    yield from ended_in_words(second, (0, 1))
    yield from lab.lost()


def dask_worker_killed(lab: Laboratory) -> Iterator[str]:
    """Kill -9 of one of two Dask workers."""
    lab.restart()
    with _cluster() as (address, _, workers):
        process = lab.started("--scheduler", address)
        lab.wait_in_work(1)
        os.kill(lab.moments.choice(children(workers.pid)), signal.SIGKILL)
        yield from good(process)
    yield from lab.lost()


def scheduler_gone(lab: Laboratory) -> Iterator[str]:
    """Kill -9 of a Dask scheduler, then --resume without it."""
    lab.restart()
    with _cluster() as (address, scheduler, workers):
        process = lab.started("--scheduler", address)
        lab.wait_in_work(1)
        scheduler.kill()
        # One that is gone before the command has asked it is a wrong address.
        yield from ended_in_words(process, (0, 1, 2))
        workers.terminate()
        workers.wait(HANGS)
    until(lambda: not locked(lab.out))
    yield from lab.lost(all_of_them=False, over=False)
    yield from lab.resumed()


# Every fault, and how often it is caused in a full run.
FAULTS: dict[str, tuple[Callable[[Laboratory], Iterator[str]], int]] = {
    "kill -9, then --resume": (killed, 30),
    "kill -9 of one of two processes": (process_killed, 6),
    "SIGINT": (interrupted(signal.SIGINT), 8),
    "SIGTERM": (interrupted(signal.SIGTERM), 8),
    "SIGINT with --scheduler local": (interrupted(signal.SIGINT, "--scheduler", "local"), 4),
    "SIGTERM with --scheduler local": (interrupted(signal.SIGTERM, "--scheduler", "local"), 4),
    "a disk that is full (tmpfs)": (disk_full, 8),
    "files that may not grow (RLIMIT_FSIZE)": (files_limited, 5),
    "too little memory (RLIMIT_AS)": (memory_scant, 8),
    "a photograph vanishes": (photograph_gone, 6),
    "a photograph changes": (photograph_changed, 6),
    "an output that cannot be written": (output_refused, 4),
    "two runs on one output": (two_runs, 4),
    "kill -9 of a Dask worker": (dask_worker_killed, 3),
    "kill -9 of the Dask scheduler": (scheduler_gone, 3),
}


@contextlib.contextmanager
def _cluster() -> Iterator[tuple[str, subprocess.Popen, subprocess.Popen]]:
    """A Dask scheduler on loopback and the parent of two workers, as processes of their own."""
    with TemporaryDirectory() as folder:
        file = Path(folder, "scheduler.json")
        quiet: dict = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        dask = [sys.executable, "-m", "dask"]
        shared = ["--scheduler-file", str(file), "--no-dashboard"]
        scheduler = subprocess.Popen([*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", *shared], **quiet)
        workers = subprocess.Popen(
            [*dask, "worker", "--nworkers", "2", "--nthreads", "1", "--local-directory", folder, *shared], **quiet
        )
        try:
            until(lambda: file.is_file() and len(children(workers.pid)) >= 2)
            address = str(re.search(r"tcp://[\d.]+:\d+", file.read_text("utf-8"))[0])  # type: ignore[index]
            yield address, scheduler, workers
        finally:
            for process in (workers, scheduler):
                process.terminate()
                process.wait(HANGS)


@contextlib.contextmanager
def _spared(capture: Path) -> Iterator[None]:
    """A capture that is as it was at the end."""
    kept = capture.with_name("kept")
    shutil.copytree(capture, kept)
    try:
        yield
    finally:
        shutil.rmtree(capture)
        kept.rename(capture)
