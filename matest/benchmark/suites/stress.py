"""Every model at adversarial directions and parameter values: non-finite results, and float32 against float64."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import torch
from rich.console import Group
from torch import Tensor

from matest.benchmark.instruments import adversarial
from matest.benchmark.instruments.adversarial import direction_pairs, parameter_values
from matest.benchmark.instruments.passes import heavy
from matest.benchmark.suite import Effort, Progress, Record, Suite
from matest.benchmark.tables import by_case, case_name, figure, largest, page, ruled
from matest.brdf import MODELS, Brdf, model, variants
from matest.progress import silent

# Adversarial points a model.
POINTS = 10_000_000
POINTS_QUICK = 8_192
# Points at a time: as many as stay near the cache,
TILE = 16_384
# and of a sum over thousands of facets as few as keep their derivatives below 3 GB.
TILE_HEAVY = 4096
SEED = 1

Inputs = dict[str, Tensor]
Results = dict[str, Tensor]


def measure(effort: Effort, progress: Progress) -> Iterator[Record]:
    """Records of every model and every choice of its options, at as many points as the time allows.

    Sums over many facets, a hundred times as slow as the others, see a tenth of the points, and a hundredth under
    options other than their default.
    """
    points, expressions = POINTS_QUICK if effort.quick else POINTS, variants()
    for expression in expressions:
        brdf = model(expression)[0]
        share = 1 if not heavy(brdf) else 10 if expression in MODELS else 100
        yield from examine(brdf, points // share, progress, effort.seconds / len(expressions))


def examine(brdf: Brdf, points: int, progress: Progress = silent, seconds: float = math.inf) -> list[Record]:
    """Count what is not finite at `points` adversarial points, and measure the worst error of float32.

    In both precisions: values and first derivatives at every point, second derivatives (reverse over reverse) and
    forward mode at one in 20, vmap of value and gradient at one in 1000. A point has its own directions and its own
    value of every parameter; derivatives are by all of them. After so many seconds it ends with the points done so far.
    """
    case = brdf.expression
    generator = torch.Generator().manual_seed(SEED)
    tallies = {(dtype, kind): _Tally() for dtype in (torch.float32, torch.float64) for kind in KINDS}
    tile = TILE_HEAVY if heavy(brdf) else TILE
    end = time.perf_counter() + seconds
    examined = 0
    while examined < points and (not examined or time.perf_counter() < end):
        n = min(tile, points - examined)
        examined += n
        wi, wo = direction_pairs(n, generator)
        inputs = {**parameter_values(brdf.declared, n, generator), "wi": wi, "wo": wo}
        for (dtype, kind), tally in tallies.items():
            compute, share = KINDS[kind]
            tally.add({name: value[: -(-n // share)].to(dtype) for name, value in inputs.items()}, compute, brdf)
        progress(case, examined, points)
    records = [Record("stress", case, "points", examined, "1", "higher")]
    for (dtype, kind), tally in tallies.items():
        metric = f"{str(dtype).removeprefix('torch.')} non-finite {kind}"
        records.append(Record("stress", case, metric, tally.broken, "1", limit=0, note=tally.note))
    worst, note = adversarial.worst_error(brdf, min(400, examined // 250), generator)
    return [*records, Record("stress", case, "float32 error", worst, "tolerance", limit=1, note=note)]


def _values(brdf: Brdf, inputs: Inputs) -> Results:
    with torch.no_grad():
        return {"value": _evaluate(brdf, inputs)}


def _reverse(brdf: Brdf, inputs: Inputs, *, second: bool = False) -> Results:
    """First derivatives, or those of a randomly weighted sum of them."""
    leaves = {name: value.detach().requires_grad_() for name, value in inputs.items()}
    first = _gradient(_evaluate(brdf, leaves).sum(), leaves, create_graph=second)
    if not second:
        return first
    # Derivatives that are constant have none of their own.
    weighted = [(slope * _random_like(slope)).sum() for slope in first.values() if slope.requires_grad]
    return _gradient(torch.stack(weighted).sum(), leaves) if weighted else {}


def _forward(brdf: Brdf, inputs: Inputs) -> Results:
    """The derivative along a random direction, by forward mode."""
    tangents = {name: _random_like(value) for name, value in inputs.items()}
    return {"value": torch.func.jvp(partial(_evaluate, brdf), (inputs,), (tangents,))[1]}


def _batched(brdf: Brdf, inputs: Inputs) -> Results:
    """Value and gradient point by point, under vmap."""
    value = torch.func.grad_and_value(lambda inputs: _evaluate(brdf, inputs).sum())
    gradients, values = torch.vmap(value)(inputs)
    return {"value": values[:, None], **{f"by {name}": gradient for name, gradient in gradients.items()}}


def _evaluate(brdf: Brdf, inputs: Inputs) -> Tensor:
    return brdf.replace({name: inputs[name] for name in brdf.declared})(inputs["wi"], inputs["wo"])


def _gradient(total: Tensor, inputs: Inputs, create_graph: bool = False) -> Results:
    gradients = torch.autograd.grad(
        total, list(inputs.values()), create_graph=create_graph, allow_unused=True, materialize_grads=True
    )
    return {f"by {name}": gradient for name, gradient in zip(inputs, gradients, strict=True)}


def _random_like(tensor: Tensor) -> Tensor:
    return torch.randn(tensor.shape, generator=torch.Generator().manual_seed(SEED), dtype=tensor.dtype)


# What is computed, and at one in how many points.
KINDS: dict[str, tuple[Callable[[Brdf, Inputs], Results], int]] = {
    "values": (_values, 1),
    "first derivatives": (_reverse, 1),
    "second derivatives": (partial(_reverse, second=True), 20),
    "forward derivatives": (_forward, 20),
    "batched derivatives": (_batched, 1000),
}


class _Tally:
    """How many points gave something that is not finite, and of every result how many, and where the first of them."""

    def __init__(self) -> None:
        self.broken = 0
        self._counts: Counter[str] = Counter()
        self._first: dict[str, str] = {}

    def add(self, inputs: Inputs, compute: Callable[[Brdf, Inputs], Results], brdf: Brdf) -> None:
        n = len(inputs["wi"])
        try:
            results = compute(brdf, inputs)
        except RuntimeError as error:
            # A model that cannot be differentiated in this way is broken everywhere; the others are still examined.
            results = {f"raised '{str(error).splitlines()[0]}'": torch.full((n, 1), torch.nan)}
        broken = torch.zeros(n, dtype=torch.bool)
        for name, result in results.items():
            bad = ~result.isfinite().flatten(1).all(dim=1)
            if bad.any():
                broken |= bad
                self._counts[name] += int(bad.sum())
                self._first.setdefault(name, adversarial.place(inputs, int(bad.nonzero()[0])))
        self.broken += int(broken.sum())

    @property
    def note(self) -> str:
        by_place: dict[str, list[str]] = {}
        for name, place in self._first.items():
            by_place.setdefault(place, []).append(f"{name} ({self._counts[name]})")
        return "\n".join(f"{', '.join(names)}: first at {place}" for place, names in by_place.items())


def table(records: Sequence[Record]) -> Group:
    """Non-finite results of every model in both precisions, the error of float32, and where the failures were."""
    failures = ruled("non-finite", *(kind.replace(" derivatives", "") for kind in KINDS), "float32\nerror")
    for case, metrics in by_case(records).items():
        failures.add_row(case_name(case))
        for dtype in ("float32", "float64"):
            counts = [metrics[f"{dtype} non-finite {kind}"] for kind in KINDS]
            error = [metrics["float32 error"]] if dtype == "float32" else []
            failures.add_row(f"  {dtype}", *map(figure, [*counts, *error]))
    shares = ", ".join(
        f"{kind.removesuffix(' derivatives')} at 1 in {share}" for kind, (_, share) in KINDS.items() if share > 1
    )
    about = (
        f"{largest(records, 'points'):,} adversarial points a model, a tenth for sums over facets ({shares}): how many "
        "gave anything not finite. Error of float32 against float64 as a multiple of the one allowed: "
        f"{adversarial.RELATIVE:g} relative or {adversarial.OF_PEAK:g} of the peak."
    )
    return page(about, failures, records=records)


SUITE = Suite(measure, table, share=150)
