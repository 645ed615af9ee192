"""Captures: photographs, their encoding and noise, and the samples they give."""

from matest.capture.batch import Batch
from matest.capture.capture import Capture, load_capture
from matest.capture.samples import Samples

__all__ = ["Batch", "Capture", "Samples", "load_capture"]
