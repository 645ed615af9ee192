"""Sums of every family: what is left with all at their best values, image by image as all at once."""

from __future__ import annotations

import pytest
import torch

from matest.inference.score_sums import ScoreSums

IMAGES, PER_IMAGE, COMMON, VALUES = 12, 4, 5, 40
COST = 1e4


def columns(seed: int) -> tuple[torch.Tensor, list[torch.Tensor]]:
    """A Jacobian [values, unknowns] of unknowns of all images, then of each by itself; and the latter's places."""
    random = torch.Generator().manual_seed(seed)
    jacobian = torch.zeros(IMAGES * VALUES, COMMON + IMAGES * PER_IMAGE, dtype=torch.float64)
    jacobian[:, :COMMON] = torch.randn(len(jacobian), COMMON, generator=random, dtype=torch.float64)
    places = []
    for image in range(IMAGES):
        rows, own = slice(image * VALUES, (image + 1) * VALUES), COMMON + PER_IMAGE * image + torch.arange(PER_IMAGE)
        jacobian[rows, own[0] : own[-1] + 1] = torch.randn(VALUES, PER_IMAGE, generator=random, dtype=torch.float64)
        # Exposure and intensity of an image do the same; and all exposures together what the scale does.
        jacobian[rows, own[3]] = 3 * jacobian[rows, own[2]]
        jacobian[rows, 4] = 1e3 * jacobian[rows, own[2]]
        places.append(own)
    return jacobian, places


def sums(jacobian: torch.Tensor, residual: torch.Tensor, fitted: list[int], alone: list[torch.Tensor]) -> ScoreSums:
    return ScoreSums(
        information=jacobian.T @ jacobian,
        scores=jacobian.T @ residual,
        fitted=torch.tensor(fitted),
        alone=alone,
        places={"common": slice(2, COMMON), "own": slice(COMMON, jacobian.shape[1])},
        by_pixel={},
        units={"common": 1.0, "own": 1.0},
        cost=COST,
        values=len(residual),
    )


@pytest.mark.parametrize("fitted", [[0, 1], [1]])
def test_everything_takes_away_what_least_squares_does(fitted: list[int]) -> None:
    jacobian, places = columns(1)
    residual = torch.randn(len(jacobian), generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    # An unknown at its bound is not free.
    free = jacobian[:, [*fitted, *range(2, jacobian.shape[1])]]
    explained = free @ torch.linalg.lstsq(free, residual, driver="gelsd").solution
    expected = (COST - float(residual @ explained)) / len(residual)
    for alone in (places, places[3:], []):
        assert sums(jacobian, residual, fitted, alone).chi2_with_everything() == pytest.approx(expected, rel=1e-9)


def test_work_grows_with_images_not_with_their_cube(monkeypatch: pytest.MonkeyPatch) -> None:
    jacobian, places = columns(1)
    sizes = []
    eigh = torch.linalg.eigh
    monkeypatch.setattr(torch.linalg, "eigh", lambda matrix: sizes.append(len(matrix)) or eigh(matrix))
    sums(jacobian, jacobian[:, 0], [0, 1], places).chi2_with_everything()
    assert sorted(sizes) == [PER_IMAGE] * IMAGES + [COMMON]


def test_what_was_fitted_is_decomposed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    jacobian, places = columns(1)
    sizes = []
    eigh = torch.linalg.eigh
    monkeypatch.setattr(torch.linalg, "eigh", lambda matrix: sizes.append(len(matrix)) or eigh(matrix))
    of_both = sums(jacobian, jacobian[:, 0], [0, 1], places)
    for name in of_both.families:
        of_both.spectrum(name)
    assert sizes.count(2) == 1
