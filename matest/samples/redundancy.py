"""Images and channels that samples leave out because they repeat others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Redundancy:
    """Images and channels that add nothing to the others, found when samples are made.

    Attributes:
        images: that are left out, each with the reason as a clause.
        channels: number of channels left out as copies of the one that is used.
        contradictions: images with the pixels of an earlier one, each with that one, although their stated lights or
            exposures differ. They are not left out.
    """

    images: Mapping[int, str] = field(default_factory=dict)
    channels: int = 0
    contradictions: Mapping[int, int] = field(default_factory=dict)
