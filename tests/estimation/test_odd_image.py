"""The image without which a model would describe the others."""

from __future__ import annotations

from matest.brdf import Lambert
from matest.capture import Capture
from matest.estimation.odd_image import spoiling_image
from tests.captures import changed
from tests.inference.judged import judged
from tests.simulated import Studio


def spoilt(images: int) -> Capture:
    """Photographs of which the last is too bright."""
    capture = Studio(size=24, lights=Studio().lights[:images]).photograph(Lambert(0.6), 0)
    return changed(capture, stored=(*capture.photographs.stored[:-1], 1.3 * capture.photographs.stored[-1]))


def test_one_image_that_spoils_the_others_is_singled_out() -> None:
    fit = judged(spoilt(6), "lambert")
    odd = spoiling_image(fit.solution.statistics, fit.samples)
    assert odd is not None
    position, chi2 = odd
    assert position == 5
    assert chi2 < 1.1


def test_of_two_images_none_is_the_odd_one() -> None:
    fit = judged(spoilt(2), "lambert")
    assert spoiling_image(fit.solution.statistics, fit.samples) is None
