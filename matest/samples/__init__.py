"""The waist: samples of measured radiance with their noise, directions and light, wherever they come from."""

from matest.samples.batch import Batch
from matest.samples.groups import Groups
from matest.samples.source import Samples
from matest.samples.tiles import Tile, Tiles

__all__ = ["Batch", "Groups", "Samples", "Tile", "Tiles"]
