"""Processes that tests send signals to."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Sequence


def hearing(command: Sequence[str]) -> subprocess.Popen[str]:
    """A process that hears signals also where the tests do not: under nohup, in the background of a shell."""
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_hear)


def _hear() -> None:
    for kind in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(kind, signal.SIG_DFL)
