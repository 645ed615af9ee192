"""Additive statistics of a pass over samples: information and gradient of the unknowns at a point, group by group."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from matest.estimators.moments import SCORES, sum_by_label, with_added_cost


@dataclass(frozen=True, eq=False)
class PriorTerms:
    """Gaussian priors of the unknowns u [P] at a point: their terms add to the sums over the samples.

    Attributes:
        precision: inverse covariance, 0 for unknowns without a prior [P, P].
        below: how far the point lies below the mean [P].
    """

    precision: Tensor
    below: Tensor

    @property
    def cost(self) -> float:
        """Squared distance from the means, in standard deviations."""
        return float(self.below @ self.pull)

    @property
    def pull(self) -> Tensor:
        """Half the rate at which the cost falls with each unknown [P]."""
        return self.precision @ self.below

    def moved(self, change: Tensor) -> PriorTerms:
        """The same where the unknowns have changed by this [P]."""
        return replace(self, below=self.below - change)


@dataclass(frozen=True, eq=False)
class Statistics:
    """Additive statistics of a pass over B groups of samples, double precision.

    A group depends on Q of the P unknowns: of multipliers only on those of its own image, light or group. `places` says
    which.

    Attributes:
        labels: of the groups [B].
        informations: JᵀWJ of each [B, Q, Q].
        gradients: JᵀWr of each [B, Q].
        scores: of the residual of each [B, S], see `SCORES`.
        places: positions in u of the Q unknowns of each group [B, Q]; None: all P, in their order.
        prior: of the unknowns; None: there is none.
        unknowns: P; None: Q.
    """

    labels: Tensor
    informations: Tensor
    gradients: Tensor
    scores: Tensor
    places: Tensor | None = None
    prior: PriorTerms | None = None
    unknowns: int | None = None

    def __len__(self) -> int:
        return len(self.labels)

    def column(self, name: str) -> Tensor:
        """One of the `SCORES` of every group [B]."""
        return self.scores[:, SCORES.index(name)]

    def total(self, name: str) -> float:
        """The sum of one of the `SCORES`."""
        return float(self.column(name).sum())

    @property
    def cost(self) -> float:
        """The cost that a fit minimises: rᵀWr of all values, and the squared distance from the priors."""
        return self.total("cost") + (0.0 if self.prior is None else self.prior.cost)

    @property
    def reduced_chi2(self) -> float:
        """χ² per value."""
        return self.total("chi2") / max(self.total("values"), 1)

    @property
    def inflation(self) -> float:
        """χ² per value, at least 1: how much larger the squared residuals are than the noise variance."""
        return max(self.reduced_chi2, 1.0)

    @property
    def outliers(self) -> float:
        """Share of outliers among the values that a goodness of fit is judged by."""
        rejected = self.total("outliers")
        return rejected / max(rejected + self.total("values"), 1)

    @property
    def relative_rmse(self) -> float:
        """Rms residual over rms signal of all usable values, outliers too; 0 without signal."""
        return self._relative("squared")

    @property
    def relative_rmse_trimmed(self) -> float:
        """The same without outliers."""
        return self._relative("trimmed")

    def _relative(self, kind: str) -> float:
        signal = self.total(f"{kind}_signal")
        return math.sqrt(self.total(f"{kind}_residual") / signal) if signal > 0 else 0.0

    @property
    def size(self) -> int:
        """P, the number of unknowns."""
        return self.gradients.shape[1] if self.unknowns is None else self.unknowns

    @property
    def information(self) -> Tensor:
        """JᵀWJ of all samples, and the precision of the priors [P, P]."""
        if self.places is None:
            total = self.informations.sum(0)
        else:
            total = torch.zeros(self.size, self.size, dtype=torch.float64)
            total.index_put_((self.places[:, :, None], self.places[:, None, :]), self.informations, accumulate=True)
        return total if self.prior is None else total + self.prior.precision

    @property
    def gradient(self) -> Tensor:
        """JᵀWr of all samples, and the pull of the priors [P]."""
        if self.places is None:
            total = self.gradients.sum(0)
        else:
            total = torch.zeros(self.size, dtype=torch.float64)
            total.index_put_((self.places,), self.gradients, accumulate=True)
        return total if self.prior is None else total + self.prior.pull

    @property
    def gradient_by_group(self) -> Tensor:
        """JᵀWr of each group by all unknowns, without the priors [B, P]."""
        return self.gradients if self.places is None else self._dense.gradients

    def only(self, position: int) -> Statistics:
        """The statistics of one of the B groups, without the priors."""
        row = slice(position, position + 1)
        places = None if self.places is None else self.places[row]
        return Statistics(
            self.labels[row], self.informations[row], self.gradients[row], self.scores[row], places, None, self.unknowns
        )

    def moved(self, change: Tensor) -> Statistics:
        """The statistics that a pass would give if the unknowns changed by this [P] and the model were linear in them.

        The unweighted squared residual stays as it is.
        """
        touched = change.expand(len(self), -1) if self.places is None else change[self.places]
        drop = (self.informations @ touched[..., None])[..., 0]
        added = ((drop - 2 * self.gradients) * touched).sum(-1)
        prior = None if self.prior is None else self.prior.moved(change)
        return replace(self, gradients=self.gradients - drop, scores=with_added_cost(self.scores, added), prior=prior)

    def regrouped(self, coarser: Tensor) -> Statistics:
        """The same statistics with groups joined; `coarser` [G] has the new label of every group."""
        labels, places = coarser[self.labels], self.places
        distinct, informations, gradients, scores = sum_by_label(labels, self.informations, self.gradients, self.scores)
        if places is not None:
            rows = torch.searchsorted(distinct, labels)
            first = torch.full_like(distinct, len(labels)).scatter_reduce(0, rows, torch.arange(len(labels)), "amin")
            if not torch.equal(places, places[first[rows]]):
                # Groups that depend on different unknowns have only all of them in common.
                return self._dense.regrouped(coarser)
            places = places[first]
        return Statistics(distinct, informations, gradients, scores, places, self.prior, self.unknowns)

    @property
    def _dense(self) -> Statistics:
        """The same statistics with the rows and columns of all P unknowns."""
        if self.places is None:
            return self
        count = len(self)
        group, rows, columns = torch.arange(count)[:, None, None], self.places[:, :, None], self.places[:, None, :]
        informations = torch.zeros(count, self.size, self.size, dtype=torch.float64)
        informations[group, rows, columns] = self.informations
        gradients = torch.zeros(count, self.size, dtype=torch.float64).scatter(1, self.places, self.gradients)
        return replace(self, informations=informations, gradients=gradients, places=None)


def statistics_of(scores: Tensor, labels: Tensor | None = None) -> Statistics:
    """Those of groups whose scores [B, S] alone are known, without unknowns; labels [B] count them if not given."""
    labels = torch.arange(len(scores)) if labels is None else labels
    none = torch.zeros(len(scores), 0, dtype=torch.float64)
    return Statistics(labels, none[..., None].expand(-1, 0, 0), none, scores)
