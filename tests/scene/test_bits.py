from __future__ import annotations

import numpy as np
import pytest
import torch

from matest.scene.bits import Bits


@pytest.mark.parametrize("count", [0, 1, 8, 1003])
def test_bits_give_back_what_they_were_made_of(rng, count):
    values = rng.random(count) < 0.4
    bits = Bits.of(values)
    assert len(bits) == count
    np.testing.assert_array_equal(np.asarray(bits), values)
    assert bits.octets.nbytes == -(-count // 8)


@pytest.mark.parametrize("kind", [np.int32, np.int64, torch.int64])
def test_bits_of_some_pixels_are_those_of_their_indices(rng, kind):
    values = rng.random(1003) < 0.4
    index = rng.permutation(1003)[:300]
    given = torch.from_numpy(index) if kind is torch.int64 else index.astype(kind)
    some = Bits.of(values)[given]
    assert some.dtype == bool
    np.testing.assert_array_equal(some, values[index])
    np.testing.assert_array_equal(Bits.of(values)[100:900:3], values[100:900:3])
