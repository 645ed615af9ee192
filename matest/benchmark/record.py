"""The records that a benchmark gives."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from matest.progress import Progress

__all__ = ["Progress", "Record"]

# The metric of the suite `limits` that tells a quick run from a full one.
QUICK = "quick"


@dataclass(frozen=True)
class Record:
    """One figure.

    Attributes:
        suite, case, metric: what was measured, of which case.
        value: the figure; None where it could not be measured.
        unit: "ns", "1"…; "pass" is the time of one element-wise product of two tensors in the same run.
        better: which way is better, "lower" or "higher".
        limit: the target, if there is one.
        note: for a person: where the worst case was, or why there is no value.
    """

    suite: str
    case: str
    metric: str
    value: float | None
    unit: str
    better: Literal["lower", "higher"] = "lower"
    limit: float | None = None
    note: str = ""

    @property
    def misses(self) -> bool:
        """Whether the value is on the wrong side of its limit."""
        if self.value is None or self.limit is None:
            return False
        return self.value > self.limit if self.better == "lower" else self.value < self.limit

    def to_dict(self) -> dict[str, Any]:
        """The record as a line of JSON, without the note."""
        return {name: value for name, value in asdict(self).items() if name != "note"}
