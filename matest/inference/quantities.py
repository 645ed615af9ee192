"""The estimate of one parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Number = float | list[float | None] | None


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter: a number, or a list of one number per channel.

    Attributes:
        value: physical value; None where it is not determined.
        std: standard error; None where there is none (fixed, at a bound, not determined).
        interval95: [lower, upper], or one such pair per channel; None where there is none.
        unit: "1", "rad", "µm".
        status: determined | at bound | tied | fixed | not determined.
        doc: what the parameter is.
    """

    value: Number
    std: Number
    interval95: Any
    unit: str
    status: str
    doc: str = ""


def channel_names(count: int) -> tuple[str, ...]:
    """Names of so many channels that nobody named: R, G, B, or numbers."""
    return ("R", "G", "B") if count == 3 else tuple(str(k) for k in range(count))
