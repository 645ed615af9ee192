"""What faults leave of results: killed processes, full disks, files that vanish, signals."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Group

from matest.benchmark.instruments.faults import FAULTS, PROMPT, ImpossibleHereError
from matest.benchmark.instruments.laboratory import laboratory
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, listed, page

# Captures of a command, and where the random moments begin.
CAPTURES, CAPTURES_QUICK = 6, 3
SEED = 0
# What a quick run causes, once each: nothing that needs rights to mount a disk, or Dask.
QUICK = (
    "kill -9, then --resume",
    "kill -9 of one of two processes",
    "SIGTERM",
    "files that may not grow (RLIMIT_FSIZE)",
    "a photograph vanishes",
    "two runs on one output",
)


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every fault: how often it was caused, and in how many cases something was lost, partial or unsaid."""
    if not Path("/proc/self/task").exists():
        yield Record("faults", "all", "tried", None, "1", "higher", note="processes are only found on Linux")
        return
    begin = time.monotonic()
    progress("estimating without faults")
    plan = {name: (FAULTS[name][0], 1) for name in QUICK} if effort.quick else FAULTS
    with laboratory(CAPTURES_QUICK if effort.quick else CAPTURES, SEED) as lab:
        for name, (cause, times) in plan.items():
            tried, troubles = 0, []
            lab.ends.clear()
            while tried < times and (not tried or time.monotonic() - begin < effort.seconds):
                progress(name, tried, times)
                tried += 1
                try:
                    trouble = [*cause(lab)]
                except ImpossibleHereError as error:
                    yield Record("faults", name, "tried", None, "1", "higher", note=str(error))
                    break
                if trouble:
                    troubles.append(f"{tried}: {'; '.join(trouble)}")
            else:
                yield Record("faults", name, "tried", tried, "1", "higher")
                yield Record("faults", name, "lost or partial", len(troubles), "1", limit=0, note="\n".join(troubles))
            if lab.ends:
                yield Record("faults", name, "seconds to the end", max(lab.ends), "s", limit=PROMPT)


def table(records: Sequence[Record]) -> Group:
    """Every fault: how often it was caused, in how many cases it spoilt something, and the slowest end."""
    metrics = ("tried", "lost or partial", "seconds to the end")
    about = (
        f"Faults at random moments of an estimate of {CAPTURES} captures ({CAPTURES_QUICK} in quick runs). Lost or "
        "partial: cases in which a complete result was lost or changed, half a one or a hidden file stayed, --resume "
        "did not bring the results of a run without fault, or the command ended with another exit code, or without a "
        "sentence."
    )
    return page(about, listed("fault", metrics, by_case(records)), records=records)


SUITE = Suite(measure, table, share=30)
