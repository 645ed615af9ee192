"""The image without which a model would describe the others."""

from __future__ import annotations

import torch

from matest.estimators import Statistics
from matest.estimators.covariance import fisher
from matest.samples import Samples

# An image spoils the fit if χ² per value without it falls below this, where the model holds for the others,
_MET_CHI2 = 1.1
# or below this share of χ² per value with it: a model that fits no image does not gain that much from leaving one out.
_SPOILT_SHARE = 0.1
# With fewer images the others do not tell which one is odd.
_MIN_IMAGES = 3


def spoiling_image(statistics: Statistics, samples: Samples) -> tuple[int, float] | None:
    """The position of the image that spoils the fit, and χ² per value without it; None: no image does.

    The optimum without an image is taken one Gauss-Newton step away from the one with it.
    """
    images = statistics.regrouped(samples.groups.image)
    if len(images) < _MIN_IMAGES:
        return None
    total, slope = images.information, images.gradient
    costs, values = images.column("cost"), images.column("values")
    unknowns = torch.ones(len(total), dtype=torch.bool)
    chi2_without = []
    for image in range(len(images)):
        information, gradient = total - images.only(image).information, slope - images.only(image).gradient
        gain = float(gradient @ fisher(information, unknowns).matrix @ gradient)
        remaining = max(float(values.sum() - values[image]), 1.0)
        chi2_without.append(float(costs.sum() - costs[image] - gain) / remaining)
    worst = min(range(len(images)), key=lambda image: chi2_without[image])
    chi2 = float(costs.sum()) / max(float(values.sum()), 1.0)
    spoils = chi2_without[worst] < max(_MET_CHI2, _SPOILT_SHARE * chi2)
    return (int(images.labels[worst]), chi2_without[worst]) if spoils else None
