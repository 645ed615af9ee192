"""Many small symmetric systems at once: T unknowns each, n systems, arrays [T, T, n].

The loops run over unknowns, so that every step is one operation on n numbers: for a handful of unknowns that is many
times faster than a call of LAPACK for each system.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

# Units of rounding of a diagonal element below which what is left of it says nothing of that unknown.
_SINGULAR = 8.0


@dataclass(frozen=True, eq=False)
class Factored:
    """The factors of symmetric matrices A = L D Lᵀ, L with a unit diagonal.

    Attributes:
        lower: L below its diagonal [T][T] of [n].
        diagonal: D [T] of [n], positive.
    """

    lower: list[list[Tensor]]
    diagonal: list[Tensor]

    @classmethod
    def of(cls, matrices: Tensor) -> Factored:
        """Factor matrices [T, T, n], positive definite but for rounding."""
        size = len(matrices)
        lower: list[list[Tensor]] = [[] for _ in range(size)]
        diagonal: list[Tensor] = []
        for row in range(size):
            for column in range(row):
                rest = matrices[row, column].clone()
                for k in range(column):
                    rest -= lower[row][k] * lower[column][k] * diagonal[k]
                lower[row].append(rest / diagonal[column])
            rest = matrices[row, row].clone()
            for k in range(row):
                rest -= lower[row][k].square() * diagonal[k]
            kind = torch.finfo(matrices.dtype)
            floor = _SINGULAR * kind.eps * matrices[row, row].abs() + kind.tiny
            diagonal.append(torch.maximum(rest, floor))
        return cls(lower, diagonal)

    def solve(self, right: Tensor) -> Tensor:
        """A⁻¹ times right-hand sides [T, ..., n]."""
        size = len(self.diagonal)
        out = list(right.clone().unbind(0))
        for row in range(size):
            for k in range(row):
                out[row] = out[row] - self.lower[row][k] * out[k]
        for row in range(size):
            out[row] = out[row] / self.diagonal[row]
        for row in reversed(range(size)):
            for k in range(row + 1, size):
                out[row] = out[row] - self.lower[k][row] * out[k]
        return torch.stack(out)

    def inverse(self) -> Tensor:
        """A⁻¹ [T, T, n]."""
        size = len(self.diagonal)
        like = self.diagonal[0]
        identity = torch.eye(size, dtype=like.dtype, device=like.device)[..., None].expand(-1, -1, len(like))
        return self.solve(identity)
