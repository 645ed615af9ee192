"""Squares of neighbouring pixels that a few samples replace, and where the model is too curved for that."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from torch import Tensor

from matest.samples.residual_scale import ResidualScale
from matest.samples.tiles import Tile

# A square is split where the model leaves the polynomial by more than this share of the noise of the square's mean.
# Smaller deviations bias an estimate by less than its noise.
_MAX_DEVIATION = 0.25


@dataclass(frozen=True, eq=False)
class Tier:
    """Squares of neighbouring pixels of one size, over which radiance is a polynomial where the surface is smooth.

    Attributes:
        shares: number of pixels that each of the n samples of a square replaces [n].
        checks: from the n samples to their polynomial at k other pixels, where the model is compared with it [k, n].
    """

    shares: Tensor
    checks: Tensor

    @property
    def size(self) -> int:
        """Samples and checks of a square in a tile."""
        return len(self.shares) + len(self.checks)


@dataclass(frozen=True)
class MergedSquares:
    """Squares of pixels at the start of a tile: for each tier the samples of all squares, then their checks.

    Attributes:
        tiers: with the number of squares of each.
        split: gives the samples of a selection of squares (per tier, bool) by smaller squares or pixel by pixel.
    """

    tiers: tuple[tuple[Tier, int], ...]
    split: Callable[[Mapping[Tier, np.ndarray]], Tile]

    def judge(self, tile: Tile, reference: Tensor, residual_scale: ResidualScale) -> tuple[Tile, Tile | None]:
        """The tile without the squares over which the model is not the polynomial, and those squares split.

        Args:
            tile: that these squares belong to.
            reference: model radiance near the solution.
            residual_scale: by which outliers are judged.
        """
        assert tile.means is not None
        pixels, curved, start = tile.means.pixels.clone(), {}, 0
        for tier, count in self.tiers:
            nodes = slice(start, start + count * len(tier.shares))
            checked = slice(nodes.stop, start := start + count * tier.size)
            # From the samples of each square to its checks, in every channel [C, count, checks].
            expected = reference[nodes].T.reshape(-1, count, len(tier.shares)) @ tier.checks.T.to(reference)
            variance = tile.batch.noise[checked].variance(reference[checked])
            allowed = _MAX_DEVIATION * residual_scale.smallest * (variance / float(tier.shares.sum())).sqrt()
            deviation = (reference[checked] - expected.flatten(1).T).abs()
            of_square = (deviation > allowed).any(dim=-1).unflatten(0, (count, -1)).any(dim=-1)
            pixels[nodes].unflatten(0, (count, -1))[of_square] = 0
            curved[tier] = of_square.cpu().numpy()
        if not any(of_square.any() for of_square in curved.values()):
            return tile, None
        return replace(tile, means=tile.means._replace(pixels=pixels)), self.split(curved)
