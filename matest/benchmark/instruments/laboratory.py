"""A place where commands on some captures meet faults, and what is left of their results."""

from __future__ import annotations

import contextlib
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from matest.report import manifest
from matest.simulate import simulate

# Model of the captures, which are small, so that faults meet every part of the work.
MODEL = "oren-nayar"
SIZE = 24
# Seconds after which a command hangs.
HANGS = 120.0
# Seconds within which another process does what it is waited for.
_SOON = 60.0
# What a command says that does not end well.
_SENTENCE = re.compile(r"^matest: .+[.?]$", re.MULTILINE)


@dataclass
class Laboratory:
    """Captures, their results where nothing goes wrong, and what went wrong so far.

    Attributes:
        folder: for captures and results.
        moments: random.
        captures: their folders.
        answers: what result.json says of each up to the command line, by name.
        span: seconds from the first sign of a command with one and with two processes to its end.
        ends: seconds that commands took to end after a signal.
    """

    folder: Path
    moments: random.Random
    captures: list[Path]
    answers: dict[str, str] = field(default_factory=dict)
    span: dict[int, float] = field(default_factory=dict)
    ends: list[float] = field(default_factory=list)

    @property
    def out(self) -> Path:
        return self.folder / "out"

    def command(self, *options: object, captures: list[Path] | None = None) -> list[str]:
        """An estimate of the captures, into `out`."""
        return [
            sys.executable, "-m", "matest", "estimate", *map(str, captures or self.captures), "--model", MODEL,
            "--pictures", "none", "-o", str(self.out), *map(str, options),
        ]  # fmt: skip

    def started(self, *options: object, limits: dict[int, int] | None = None) -> subprocess.Popen[str]:
        """A command that has begun with the captures, and that hears signals where this process does not."""

        def prepare() -> None:
            # Under nohup and in the background of a shell they are ignored, and Python then leaves it at that.
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_DFL)
            for kind, value in (limits or {}).items():
                resource.setrlimit(kind, (value, value))

        process = subprocess.Popen(self.command(*options), **PIPES, preexec_fn=prepare)
        until(lambda: process.poll() is not None or (self.folder / ".out.matest-lock").exists())
        return process

    def wait_in_work(self, processes: int) -> None:
        """Wait until a random moment of what a command takes."""
        time.sleep(self.moments.uniform(0, self.span[processes]))

    def restart(self, earlier: bool = False) -> None:
        """Remove results, or replace them by the earlier ones of all captures."""
        shutil.rmtree(self.out, ignore_errors=True)
        if earlier:
            shutil.copytree(self.folder / "earlier", self.out)

    def complete(self) -> list[str]:
        """Names of the captures that have a result."""
        return sorted(path.name for path in self.out.glob("*") if path.is_dir() and not path.name.startswith("."))

    def lost(self, all_of_them: bool = True, over: bool = True) -> Iterator[str]:
        """What is wrong with the results that there are.

        Args:
            all_of_them: whether every capture should have one.
            over: whether nothing but them should be there: not so after a process was killed.
        """
        names = self.complete()
        if all_of_them and names != sorted(self.answers):
            yield f"only {len(names)} of {len(self.answers)} results"
        for name in names:
            if not manifest.is_whole(self.out / name):
                yield f"{name} is not whole"
            elif answer_of(self.out / name) != self.answers[name]:
                yield f"{name} has another result"
        if over and (hidden := [path.name for path in _hidden(self.folder)]):
            yield f"left over: {', '.join(hidden)}"

    def resumed(self) -> Iterator[str]:
        """What is wrong after the same command with --resume."""
        code, _, errors = ended(subprocess.Popen(self.command("--resume"), **PIPES))
        if code:
            yield f"--resume ends with {code}: {errors}"
        yield from self.lost()


PIPES: dict = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}


@contextlib.contextmanager
def laboratory(captures: int, seed: int) -> Iterator[Laboratory]:
    """So many captures of different noise, and their results, in a temporary folder."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        made = [_capture(folder, number) for number in range(captures)]
        lab = Laboratory(folder, random.Random(seed), made)
        for processes in (1, 2):
            lab.restart()
            begin = time.monotonic()
            process = lab.started("--jobs", processes)
            begin = time.monotonic()
            code, _, errors = ended(process)
            lab.span[processes] = time.monotonic() - begin
            if code:
                raise RuntimeError(f"the captures of the faults cannot be estimated: {errors}")
        lab.answers = {capture.name: answer_of(lab.out / capture.name) for capture in made}
        shutil.copytree(lab.out, folder / "earlier")
        yield lab


def _capture(folder: Path, number: int) -> Path:
    """A ball under three lights."""
    lights = ([0.1, 0.2, 0.97], [0.7, 0.2, 0.68], [-0.7, 0.3, 0.65])
    scene = folder / f"scene{number}"
    scene.mkdir()
    (scene / "scene.toml").write_text(
        f'[material]\nmodel = "{MODEL}"\nalbedo = 0.5\nsigma = 0.4\n'
        f'[geometry]\nshape = "sphere"\ncentre = [{SIZE / 2}, {SIZE / 2}]\nradius = {0.45 * SIZE}\n'
        f"[camera]\nresolution = [{SIZE}, {SIZE}]\n"
        f"[noise]\nread = 0.002\ngain = 0.0005\nbits = 16\nseed = {number + 1}\n"
        + "".join(f"[[image]]\nlights = [ {{ direction = {light}, irradiance = 3.0 }} ]\n" for light in lights),
        "utf-8",
    )
    return simulate(scene, folder / f"ball{number}")


def answer_of(result: Path) -> str:
    """What two runs of one capture have in common: result.json up to the command line and the time."""
    return (result / "result.json").read_text("utf-8").partition('"command"')[0]


def good(process: subprocess.Popen[str]) -> Iterator[str]:
    code, _, errors = ended(process)
    if code:
        yield f"ended with {code}: {errors}"


def ended_in_words(process: subprocess.Popen[str], codes: tuple[int, ...], name: str = "") -> Iterator[str]:
    """What is wrong with how a command ended."""
    code, _, errors = ended(process)
    yield from unworded(code, errors, codes, name)


def unworded(code: int, errors: str, codes: tuple[int, ...], name: str = "") -> Iterator[str]:
    """What is wrong with an end: another exit code, no sentence, or a traceback."""
    told = _SENTENCE.search(errors) is not None and name in errors
    if code not in codes or (code and not told) or "Traceback" in errors or "fault of matest" in errors:
        yield f"ended with {code}: {errors}"


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit code and output of a process; one that hangs is killed, and has the code of that."""
    try:
        out, errors = process.communicate(timeout=HANGS)
    except subprocess.TimeoutExpired:
        process.kill()
        out, errors = process.communicate()
    return process.returncode, out, errors


def until(holds: Callable[[], bool]) -> None:
    """Wait until something holds.

    Raises:
        TimeoutError: it does not, for long.
    """
    end = time.monotonic() + _SOON
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError("what was waited for did not come")
        time.sleep(0.005)


def children(process: int) -> list[int]:
    """Processes that a process has started and that do the work: not those that only keep count."""
    children = [
        int(one) for file in Path(f"/proc/{process}/task").glob("*/children") for one in file.read_text().split()
    ]
    return [child for child in children if b"resource_tracker" not in Path(f"/proc/{child}/cmdline").read_bytes()]


def _hidden(folder: Path) -> list[Path]:
    return list(folder.rglob(".*"))


def locked(out: Path) -> bool:
    """Whether a process has the right to write to one of the results."""
    from filelock import FileLock, Timeout

    for file in out.glob(".*.matest-lock"):
        try:
            with FileLock(file, timeout=0):
                pass
        except Timeout:
            return True
    return False
