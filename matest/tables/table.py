"""A measured reflectance in memory, whatever file it comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from torch import Tensor

# Numbers of a file that are larger are no measurements: their squares must stay within single precision.
LARGEST = 1e15


@dataclass(frozen=True, eq=False)
class Table:
    """n measured values of a reflectance f(wi, wo), each in C channels.

    Attributes:
        path: of the file.
        wi, wo: unit vectors to the light and to the viewer, both above the horizon [n, 3].
        values: f in 1/sr [n, C]; values that are not positive are measurements of what is dark.
        channels: names, as R or 450 nm.
        wavelengths: of the channels in µm [C]; None: not stated.
        measure: solid angles of light and viewer that each value stands for, 1 on average [n, 1]; None: all the same.
        relative: whether the values are known up to one common factor only.
        notes: how the file was read, as sentences.
        skipped: number of entries left out, by reason.
    """

    path: Path
    wi: Tensor
    wo: Tensor
    values: Tensor
    channels: Sequence[str]
    wavelengths: Tensor | None = None
    measure: Tensor | None = None
    relative: bool = False
    notes: Sequence[str] = ()
    skipped: Mapping[str, int] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"Table({self.path.name}: {len(self):,} pairs of directions, {len(self.channels)} channels)"

    def __len__(self) -> int:
        return len(self.values)
