"""Other ways to read samples: what may have been meant where what is stated of them does not fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matest.samples.account import CalibratedSamples


@dataclass(frozen=True, eq=False)
class Reading:
    """Samples with one mistake in what is stated of them undone.

    Attributes:
        cause: name of the mistake, such as "normals y down".
        finding: what seems to be the case, as a clause.
        instead: how the samples are read here, as a phrase.
        mend: what to do about it, as a sentence.
        samples: read that way, few of them.
        order: of each image the number of the one whose stated lights are its own; empty where each has its own.
    """

    cause: str
    finding: str
    instead: str
    mend: str
    samples: CalibratedSamples
    order: tuple[int, ...] = ()
