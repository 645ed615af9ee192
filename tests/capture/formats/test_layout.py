from __future__ import annotations

from matest.capture.formats import LAYOUTS
from matest.capture.formats.layout import Layout


def test_layouts_have_names_and_signs_of_their_own() -> None:
    assert all(isinstance(layout, Layout) for layout in LAYOUTS)
    for key in ("name", "signs"):
        assert len({getattr(layout, key) for layout in LAYOUTS}) == len(LAYOUTS)
