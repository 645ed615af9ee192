"""What samples leave out because others say it already."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Redundancy:
    """Images and channels that add nothing to the others, found when samples are made.

    Attributes:
        images: that are left out, each with the reason as a clause.
        channels: number of channels that are left out as copies of the one that is there.
        contradictions: images that hold the pixels of an earlier one, and which, although they are stated to be under
            other lights or exposures. They are not left out.
    """

    images: Mapping[int, str] = field(default_factory=dict)
    channels: int = 0
    contradictions: Mapping[int, int] = field(default_factory=dict)
