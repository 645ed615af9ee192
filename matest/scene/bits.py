"""Sets of pixels that take one bit for each pixel of a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Bits:
    """Whether each of N pixels belongs to a set.

    Attributes:
        octets: of eight pixels each, the first in the highest bit, uint8 [N / 8].
        count: N.
    """

    octets: np.ndarray
    count: int

    @classmethod
    def of(cls, values: np.ndarray) -> Bits:
        """The set of the pixels that are True [N]."""
        return cls(np.packbits(values), len(values))

    def __len__(self) -> int:
        return self.count

    def __array__(self, dtype: type | None = None, copy: bool | None = None) -> np.ndarray:
        """All N booleans."""
        values = np.unpackbits(self.octets, count=self.count).view(bool)
        return values if dtype is None else values.astype(dtype, copy=bool(copy))

    def __getitem__(self, index: np.ndarray | Tensor | slice) -> np.ndarray:
        """Whether some pixels belong to the set, bool [n]."""
        if isinstance(index, slice):
            return np.asarray(self)[index]
        places = np.asarray(index)
        return (self.octets[places >> 3] >> (7 - (places & 7)).astype(np.uint8) & 1).view(bool)
