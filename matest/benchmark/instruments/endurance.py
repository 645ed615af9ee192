"""Damaged files for a reader, in a process of its own that may crash, hang or fill its memory."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from matest.benchmark.instruments.damage import OF_BYTES, Damage, damaged
from matest.errors import InputError

# Contents of a folder, by name.
Files = Mapping[str, bytes]
SEED = 7
# Processor seconds after which a reader hangs, and seconds by the clock, on a machine that has other work.
HANG = 10.0
_WAIT = 120.0
# Megabytes that any file may say it holds.
_DECLARED = 64
# As many times what a file says it holds a reader may take.
_TIMES = 4
# Bytes of addresses beyond those in use: the net below the measured memory.
_ADDRESSES = 4 << 30
# Where files are written: in memory, if there is such a folder.
_PLACE = "/dev/shm"
# Inputs after which a process is replaced, so that what libraries leave behind does not add up.
_LIFE = 20_000
# Different faults that are told of a reader.
_TOLD = 20


@dataclass(frozen=True)
class Reader:
    """Something that reads files.

    Attributes:
        name: for the table.
        file: that is damaged, from its folder.
        make: contents of folders that are read as they are, each with `file`.
        read: of a folder; the numbers that it gives, which have to be finite. It may refuse with an InputError.
        damages: done to the file.
        cost: of reading, about, as a multiple of that of a small image.
        megabytes: that a file may say it holds.
        seconds: of the processor, after which it hangs.
    """

    name: str
    file: str
    make: Callable[[], Sequence[Files]]
    read: Callable[[Path], Iterable[Any]]
    damages: tuple[Damage, ...] = OF_BYTES
    cost: int = 1
    megabytes: int = _DECLARED
    seconds: float = HANG

    def damaged(self, number: int) -> bytes:
        """The content of the file for an input, the same every time."""
        return _damaged(self, [files[self.file] for files in self.make()], number)


@dataclass(frozen=True)
class Fault:
    """An input that ended badly.

    Attributes:
        number: of the input.
        words: what happened, and where.
    """

    number: int
    words: str


@dataclass
class Account:
    """What became of the inputs of a reader: how many were read and refused, and the faults, each kind once."""

    read: int = 0
    refused: int = 0
    faults: int = 0
    told: list[Fault] = field(default_factory=list)

    @property
    def inputs(self) -> int:
        return self.read + self.refused + self.faults

    def add(self, fault: Fault) -> None:
        self.faults += 1
        if len(self.told) < _TOLD and fault.words not in (other.words for other in self.told):
            self.told.append(fault)


class Endurance:
    """A process that reads damaged files, and is replaced when one of them ends it."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")
        # Number of the present input, and how many were read and refused since the process was asked.
        self._shared = self._context.RawArray("q", 3)
        self._process: Any = None
        self._age = 0

    def __enter__(self) -> Endurance:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def account(self, reader: Reader, inputs: int, seconds: float = math.inf) -> Account:
        """Let a reader read damaged files.

        Args:
            reader: of module level, so that the process can import it.
            inputs: number of files.
            seconds: after which no further one is begun.

        Raises:
            RuntimeError: the reader does not read what it should, or the process cannot begin.
        """
        account, number, end = Account(), 0, time.time() + seconds
        while number < inputs and time.time() < end:
            last = min(inputs, number + _LIFE)
            number = self._ask(reader, number, last, end, account)
        return account

    def _ask(self, reader: Reader, first: int, last: int, end: float, account: Account) -> int:
        """Let the process read some inputs; returns the number of the next."""
        if self._process is None or self._age + last - first > _LIFE:
            self._end()
            self._start()
        self._age += last - first
        self._shared[:] = [first - 1, 0, 0]
        self._pipe.send((reader, first, last, end))
        following = last
        try:
            while (message := self._pipe.recv()) is not None:
                if isinstance(message, str):
                    raise RuntimeError(f"{reader.name}: {message}")
                account.add(message)
        except EOFError:
            self._process.join()
            if self._shared[0] < first:
                raise RuntimeError(f"{reader.name}: the process ended before it read a damaged file") from None
            account.add(Fault(self._shared[0], _ending(self._process.exitcode, reader.seconds)))
            following = self._shared[0] + 1
            self._process = None
        account.read += self._shared[1]
        account.refused += self._shared[2]
        return following if time.time() < end else last

    def _start(self) -> None:
        self._pipe, other = self._context.Pipe()
        self._process = self._context.Process(target=_serve, args=(other, self._shared), daemon=True)
        self._process.start()
        # So that its end is noticed here.
        other.close()
        self._age = 0

    def _end(self) -> None:
        if self._process is not None:
            self._pipe.close()
            self._process.join()
            self._process = None


def _ending(code: int, seconds: float) -> str:
    """Why a process ended."""
    if code in (-signal.SIGPROF, -signal.SIGALRM):
        return f"no end in {seconds:g} s"
    return f"the process ended by {signal.Signals(-code).name}" if code < 0 else f"the process ended with {code}"


def _serve(pipe: Any, shared: Any) -> None:
    """Read what is asked for until nobody asks any more."""
    # As the command has it; but a warning of our own code is a fault.
    warnings.simplefilter("ignore")
    warnings.filterwarnings("error", category=RuntimeWarning, module="matest")
    # A keyboard's interruption is for the process above.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with tempfile.TemporaryFile() as printed, open(os.devnull, "wb") as nowhere:
        # Likewise: what libraries print as errors is not seen.
        os.dup2(printed.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        sys.stderr = sys.stdout
        _serve_silently(pipe, shared)


def _serve_silently(pipe: Any, shared: Any) -> None:
    with tempfile.TemporaryDirectory(dir=_PLACE if os.access(_PLACE, os.W_OK) else None) as place, suppress(EOFError):
        while True:
            reader, first, last, end = pipe.recv()
            folder = Path(tempfile.mkdtemp(dir=place))
            try:
                makes = _warm(reader, folder)
                _printed()
            except Exception as error:
                pipe.send(f"a file as it should be is not read: {error}")
                continue
            for number in range(first, last):
                if time.time() > end:
                    break
                shared[0] = number
                (folder / reader.file).write_bytes(_damaged(reader, makes, number))
                if words := _outcome(reader, folder, shared):
                    pipe.send(Fault(number, words))
            pipe.send(None)


def _damaged(reader: Reader, contents: Sequence[bytes], number: int) -> bytes:
    return damaged(contents, reader.damages, np.random.default_rng([SEED, crc32(reader.name.encode()), number]))


def _warm(reader: Reader, folder: Path) -> list[bytes]:
    """Read what is as it should be, which loads libraries; the contents of the file that will be damaged."""
    folders = reader.make()
    for files in folders:
        for name, content in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        for numbers in reader.read(folder):
            if not np.isfinite(np.asarray(numbers, dtype=float)).all():
                raise ValueError("it gives numbers that are not finite")
    _limit_addresses()
    return [files[reader.file] for files in folders]


def _outcome(reader: Reader, folder: Path, shared: Any) -> str:
    """Read the folder; what went wrong, or nothing."""
    before = _begin_peak()
    signal.setitimer(signal.ITIMER_PROF, reader.seconds)
    signal.setitimer(signal.ITIMER_REAL, _WAIT)
    try:
        finite = all(np.isfinite(np.asarray(numbers, dtype=float)).all() for numbers in reader.read(folder))
        words, place = ("" if finite else "numbers that are not finite"), 1
    except InputError as error:
        words, place = _unlike_a_sentence(str(error), folder), 2
    except MemoryError:
        words, place = "out of memory", 0
    except Exception as error:
        words, place = f"{type(error).__name__}: {_first_line(error)} ({_origin(error)})", 0
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
    taken, printed = _peak() - before, _printed()
    if not words and taken > _TIMES * reader.megabytes:
        words = f"more than {_TIMES * reader.megabytes} MB of memory"
    words = words or printed
    if not words:
        shared[place] += 1
    return words


def _printed() -> str:
    """What was printed since the last call, which only the command itself should do."""
    sys.stdout.flush()
    if not os.fstat(1).st_size:
        return ""
    text = os.pread(1, 100, 0).decode("utf-8", "replace")
    os.ftruncate(1, 0)
    os.lseek(1, 0, os.SEEK_SET)
    return f"prints: {text.strip()}"


def _unlike_a_sentence(text: str, folder: Path) -> str:
    """In what a refusal is none that a user understands."""
    if str(folder) not in text:
        return f"a refusal that names no file: {text[:100]}"
    if "\n" in text.strip() or text[-1] not in ".?":
        return f"a refusal that is no sentence: {text.replace(str(folder), '')[:100]!r}"
    return ""


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), "")[:100]


def _origin(error: Exception) -> str:
    """The line of matest that an exception came through last."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "matest" in frame.filename]
    return f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""


def available() -> bool:
    """Whether memory and time of a process can be limited and measured here as this needs it."""
    return sys.platform == "linux" and os.access("/proc/self/clear_refs", os.W_OK)


def _limit_addresses() -> None:
    import resource

    used = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + _ADDRESSES, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _begin_peak() -> float:
    """Forget the peak of memory so far; megabytes in use."""
    Path("/proc/self/clear_refs").write_bytes(b"5")
    return _status("VmRSS")


def _peak() -> float:
    """Megabytes that were in use at most since `_begin_peak`."""
    return _status("VmHWM")


def _status(name: str) -> float:
    with open("/proc/self/status", encoding="ascii", errors="replace") as lines:
        return next(int(line.split()[1]) for line in lines if line.startswith(name)) / 1024


def accounts(readers: Sequence[Reader], inputs: int, seconds: float = math.inf) -> Iterator[tuple[Reader, Account]]:
    """What becomes of damaged files, reader by reader.

    Args:
        readers: of module level.
        inputs: number of files of one whose cost is 1.
        seconds: of all together, about.
    """
    with Endurance() as endurance:
        for number, reader in enumerate(readers):
            begin = time.time()
            yield reader, endurance.account(reader, max(inputs // reader.cost, 1), seconds / (len(readers) - number))
            seconds -= time.time() - begin
