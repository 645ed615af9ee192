from __future__ import annotations

import numpy as np
import pytest

from matest.photographs.storage import Storage, release


def test_arrays_within_the_budget_are_kept_as_they_are() -> None:
    array = np.arange(6.0)
    assert Storage().keep(array) is array


def test_arrays_beyond_the_budget_are_mapped_and_read_again_after_their_release(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("matest.photographs.storage.MEMORY_BUDGET", 100)
    storage, arrays = Storage(), [np.full((5, 3), k, np.float32) for k in range(3)]
    kept = [storage.keep(array) for array in arrays]
    assert [isinstance(array, np.memmap) for array in kept] == [False, True, True]
    for array, original in zip(kept, arrays, strict=True):
        release(array)
        np.testing.assert_array_equal(array, original)
