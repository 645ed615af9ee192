"""Squares of neighbouring pixels that a few samples stand for, and where they may not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from torch import Tensor

from matest.samples.tiles import Tile

# A square of pixels is taken apart where the model leaves its polynomial by more than this share of the noise of its
# mean.
_BENT = 0.25


@dataclass(frozen=True, eq=False)
class Tier:
    """Squares of neighbouring pixels of one size, over which radiance is a polynomial where the surface is smooth.

    Attributes:
        shares: how many pixels each of the n samples stands for that stand for such a square [n].
        checks: the polynomial through n values at k other places, where it is compared with the model [k, n].
    """

    shares: Tensor
    checks: Tensor

    @property
    def size(self) -> int:
        """Samples that a square takes in a tile."""
        return len(self.shares) + len(self.checks)


@dataclass(frozen=True)
class Merged:
    """Squares of pixels in a tile: of each tier first what stands for them, then where they are checked.

    Attributes:
        tiers: with the number of squares of each.
        finer: gives the samples of some of the squares (of each tier which, bool) by smaller squares or pixel by pixel.
    """

    tiers: tuple[tuple[Tier, int], ...]
    finer: Callable[[Mapping[Tier, np.ndarray]], Tile]

    def judge(self, tile: Tile, reference: Tensor, residual_scale: float) -> tuple[Tile, Tile | None]:
        """The tile without squares over which the model is no such polynomial, and those by themselves.

        Args:
            tile: that these squares belong to.
            reference, residual_scale: as in `likelihood.about`.
        """
        assert tile.means is not None
        pixels, bent, start = tile.means.pixels.clone(), {}, 0
        for tier, count in self.tiers:
            nodes = slice(start, start + count * len(tier.shares))
            checked = slice(nodes.stop, start := start + count * tier.size)
            expected = tier.checks.to(reference) @ reference[nodes].unflatten(0, (count, -1))
            variance = tile.batch.noise[checked].variance(reference[checked])
            allowed = _BENT * residual_scale * (variance / float(tier.shares.sum())).sqrt()
            deviation = (reference[checked] - expected.flatten(0, 1)).abs()
            of_square = (deviation > allowed).any(dim=-1).unflatten(0, (count, -1)).any(dim=-1)
            pixels[nodes].unflatten(0, (count, -1))[of_square] = 0
            bent[tier] = of_square.cpu().numpy()
        if not any(of_square.any() for of_square in bent.values()):
            return tile, None
        return replace(tile, means=tile.means._replace(pixels=pixels)), self.finer(bent)
