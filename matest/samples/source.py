"""What is asked of samples, wherever they come from."""

from __future__ import annotations

from typing import Protocol

from matest.samples.groups import Groups


class Source(Protocol):
    """Samples of photographs, of a table, of another model."""

    @property
    def noise_stated(self) -> bool:
        """Whether the noise is known; if not, it was estimated from the samples themselves."""

    @property
    def groups(self) -> Groups:
        """Samples whose errors may be correlated, and what was measured at once."""
