"""Models as `torch.nn.Module`, for people who write their own training loop."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from matest.brdf import Brdf
from matest.errors import InputError, nearest
from matest.parameters import Role
from matest.samples import Batch


class Trainable(nn.Module):
    """A model whose parameters any optimiser may move freely: they are unconstrained inside.

    Calling it returns the model at the current values, which are always inside their domains. Like every material of
    `fit_gradient` it takes a batch of samples: what has a map comes as the values at the pixels of these [n, 1 or C].
    Without a batch a map has its values at all pixels, as `matest.render` takes them.

    Args:
        brdf: the model at its starting values; a value at an end of its domain starts 1e-6 inside. What has a map may
            start from one value, one for every channel [C], or one for every pixel [N, 1 or C], as the material of an
            estimate with maps has them.
        fixed: names (in a sum: paths) of parameters that do not train. Parameters that an estimate holds, such as `f0`
            of a dielectric, train unless they are named here.
        relative: whether the strength of the lights is unknown, as in a capture of relative radiometry. Then albedos
            may be above 1, and `interreflection`, which is 1 only if that strength is known, trains too.
        dtype: of the parameters.
        maps: names (in a sum: paths) of parameters with a value at every pixel, as ["albedo", "sigma"] or
            "albedo,sigma".
        texels: N, the pixels of the object, as `len(capture.scene.surface)`; it goes with `maps`.

    Raises:
        InputError: a name in `fixed` or `maps` that the model does not have, a map that is fixed, a number of values
            that is not that of the pixels.
    """

    def __init__(
        self,
        brdf: Brdf,
        *,
        fixed: tuple[str, ...] = (),
        relative: bool = False,
        dtype: torch.dtype = torch.float32,
        maps: str | Sequence[str] = (),
        texels: int | None = None,
    ) -> None:
        super().__init__()
        self.maps = tuple(name.strip() for name in maps.split(",")) if isinstance(maps, str) else tuple(maps)
        self.texels = texels
        for name in (*fixed, *self.maps):
            if name not in brdf.declared:
                raise InputError(f"{brdf.expression} has no parameter '{name}'; {nearest(name, brdf.declared)}")
        self._brdf = brdf
        self._free = [
            name
            for name, declared in brdf.declared.items()
            if name not in fixed and (relative or declared.role is not Role.GAUGE)
        ]
        self._check_maps()
        scales = brdf.structure.scales if relative else frozenset()
        domains = {name: brdf.declared[name].domain for name in self._free}
        self._domains = {name: domain.lifted() if name in scales else domain for name, domain in domains.items()}
        self.values = nn.ParameterList(
            nn.Parameter(domain.unconstrained(self._start(name).to(dtype))) for name, domain in self._domains.items()
        )

    def _check_maps(self) -> None:
        """Refuse maps that do not train, or are not of the surface's pixels."""
        if bool(self.maps) != (self.texels is not None):
            raise InputError(
                "maps and texels go together: name what has a value at every pixel, as maps='albedo', and give their "
                "number, as texels=len(capture.scene.surface)."
            )
        if self.texels is not None and not (isinstance(self.texels, int) and self.texels > 0):
            raise InputError(
                f"texels is the number of pixels of the surface, a positive whole number; got {self.texels}."
            )
        for name in self.maps:
            if name not in self._free:
                raise InputError(f"'{name}' does not train, so that it has no map: leave it out of maps.")
        for name, value in self._brdf.parameters.items():
            if self.texels is None or value.ndim < 2:
                continue
            if name not in self.maps:
                raise InputError(f"'{name}' starts from a value at every pixel: name it in maps, or give one value.")
            if value.ndim > 2 or len(value) != self.texels:
                raise InputError(
                    f"the map of '{name}' starts from values of shape {list(value.shape)}, while texels={self.texels}: "
                    "give one value, one a channel, or the values at the pixels of the same surface."
                )

    def _start(self, name: str) -> Tensor:
        """The starting value of a parameter: [N, 1 or C] where it has a map."""
        value = self._brdf.parameters[name].detach()
        if name not in self.maps:
            return value
        return torch.atleast_1d(value).expand(self.texels or 0, -1).clone()

    def extra_repr(self) -> str:
        """The model's expression, what has a map, and the values of parameters that do not train."""
        mapped = [f"{name}=map of {self.texels} pixels" for name in self.maps]
        fixed = [f"{name}={value.tolist()}" for name, value in self._brdf.parameters.items() if name not in self._free]
        return ", ".join([self._brdf.expression, *mapped, *fixed])

    def forward(self, batch: Batch | None = None) -> Brdf:
        pixels = None if batch is None or not self.maps else self._pixels(batch)
        values = {}
        for (name, domain), raw in zip(self._domains.items(), self.values, strict=True):
            gathered = raw if pixels is None or name not in self.maps else raw.index_select(0, pixels)
            values[name] = domain.physical(gathered)
        return self._brdf.replace(values)

    def _pixels(self, batch: Batch) -> Tensor:
        """The pixels of a batch [n].

        Raises:
            InputError: it has none, or they are of another surface.
        """
        if batch.pixels is None:
            raise InputError(
                f"a map of '{self.maps[0]}' needs samples that lie in pixels, and these have none: take "
                "capture.samples(), or leave maps out."
            )
        if len(batch) and int(batch.pixels.max()) >= (self.texels or 0):
            raise InputError(
                f"the samples lie in pixels up to {int(batch.pixels.max())}, while texels={self.texels}: give "
                "texels=len(capture.scene.surface) of the capture that the samples are of."
            )
        return batch.pixels

    def map(self, name: str) -> Tensor:
        """The values of a map at all pixels [N, 1 or C], differentiable; `surface.image` lays them out [H, W, 1 or C].

        Raises:
            InputError: a parameter without a map.
        """
        if name not in self.maps:
            raise InputError(f"'{name}' has no map; {nearest(name, self.maps) if self.maps else 'name it in maps.'}")
        return self().parameters[name]
