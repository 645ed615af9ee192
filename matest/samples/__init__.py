"""The waist: samples of measured radiance with their noise, directions and light, wherever they come from."""

from matest.samples.batch import Batch

__all__ = ["Batch"]
