"""How far photographs are from a model whose radiance is given, whatever it depends on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from matest.estimators.moments import SCORES, runs, score_sums, sum_by_label
from matest.estimators.statistics import Statistics, statistics_of
from matest.estimators.tile_sums import Expanded, over_tiles
from matest.samples import Tile, Tiles
from matest.samples.likelihood import LeastSquares
from matest.samples.residual_scale import NOISE_ALONE


@dataclass(frozen=True, eq=False)
class Misfit:
    """How far samples are from a model.

    Attributes:
        statistics: their scores, without unknowns.
        errors: relative error of each sample with a usable value that is not 0: the length of its residual over that of
            its radiance, over the channels [n].
    """

    statistics: Statistics
    errors: Tensor


def misfit(radiance: Callable[[Tile], Tensor], tiles: Tiles) -> Misfit:
    """How far samples are from a model.

    Args:
        radiance: gives that of the model at the samples of a tile [n, C].
        tiles: of single pixels.
    """

    def expand(tile: Tile) -> Expanded[tuple[Tensor, Tensor, Tensor]]:
        model = radiance(tile)
        return Expanded(model, lambda tile, squares: _of_tile(tile, squares, model))

    parts = [_nothing(), *over_tiles(tiles, expand, NOISE_ALONE)]
    labels, scores, errors = (torch.cat(column) for column in zip(*parts, strict=True))
    labels, scores = sum_by_label(labels, scores)
    return Misfit(statistics_of(scores, labels), errors)


def _nothing() -> tuple[Tensor, Tensor, Tensor]:
    """Labels, scores and errors of no sample."""
    return torch.zeros(0, dtype=torch.int64), torch.zeros(0, len(SCORES), dtype=torch.float64), torch.zeros(0)


def _of_tile(tile: Tile, squares: LeastSquares, model: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Labels of the groups of a tile [B], their scores [B, S], and the errors of the samples [n]."""
    labels, parts = runs(tile.batch.groups, len(tile))
    weight, residual = squares.weight.T.contiguous(), (squares.response - model).T.contiguous()
    return labels, score_sums(squares, weight, residual, parts), _errors(squares, model)


def _errors(squares: LeastSquares, model: Tensor) -> Tensor:
    """See `Misfit`."""
    measured, usable = squares.response, torch.ones_like(model)
    if squares.errors is not None:
        measured, usable = squares.errors.measured, squares.errors.usable.to(model)
    signal = (measured * usable).square().sum(1)
    residual = ((measured - model) * usable).square().sum(1)
    seen = signal > 0
    return (residual[seen] / signal[seen]).sqrt().float().cpu()
