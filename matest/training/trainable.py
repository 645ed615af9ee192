"""Models as `torch.nn.Module`, for people who write their own training loop."""

from __future__ import annotations

import torch
from torch import nn

from matest.brdf import Brdf
from matest.errors import InputError, nearest
from matest.parameters import Role
from matest.samples import Batch


class Trainable(nn.Module):
    """A model whose parameters any optimiser may move freely: they are unconstrained inside.

    Calling it returns the model at the current values, which are always inside their domains. Like every material of
    `fit_gradient` it takes a batch of samples, but does not use it: the material is the same everywhere.

    Args:
        brdf: the model at its starting values; a value at an end of its domain starts 1e-6 inside.
        fixed: names (in a sum: paths) of parameters that do not train. Parameters that an estimate holds, such as `f0`
            of a dielectric, train unless they are named here.
        relative: whether the strength of the lights is unknown, as in a capture of relative radiometry. Then albedos
            may be above 1, and `interreflection`, which is 1 only if that strength is known, trains too.
        dtype: of the parameters.

    Raises:
        InputError: a name in `fixed` that the model does not have.
    """

    def __init__(
        self,
        brdf: Brdf,
        *,
        fixed: tuple[str, ...] = (),
        relative: bool = False,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__()
        for name in fixed:
            if name not in brdf.declared:
                raise InputError(f"{brdf.expression} has no parameter '{name}'; {nearest(name, brdf.declared)}")
        self._brdf = brdf
        self._free = [
            name
            for name, declared in brdf.declared.items()
            if name not in fixed and (relative or declared.role is not Role.GAUGE)
        ]
        scales = brdf.structure.scales if relative else frozenset()
        domains = {name: brdf.declared[name].domain for name in self._free}
        self._domains = {name: domain.lifted() if name in scales else domain for name, domain in domains.items()}
        self.values = nn.ParameterList(
            nn.Parameter(domain.unconstrained(brdf.parameters[name].detach().to(dtype)))
            for name, domain in self._domains.items()
        )

    def extra_repr(self) -> str:
        """The model's expression, and the values of parameters that do not train."""
        fixed = [f"{name}={value.tolist()}" for name, value in self._brdf.parameters.items() if name not in self._free]
        return ", ".join([self._brdf.expression, *fixed])

    def forward(self, batch: Batch | None = None) -> Brdf:  # noqa: ARG002
        pairs = zip(self._domains.items(), self.values, strict=True)
        return self._brdf.replace({name: domain.physical(raw) for (name, domain), raw in pairs})
