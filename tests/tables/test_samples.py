"""A table as samples: grouped by incidence, streamed, and a subsample of it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from matest.brdf import CookTorrance, Lambert
from matest.directions import from_angles
from matest.parameters import Role
from matest.samples import Samples
from matest.tables import Table
from matest.tables.loss import Loss
from matest.tables.noise import first_noise, stated_noise
from matest.tables.samples import TableSamples
from tests.tables.goniometer import hemispherical, measured

GLOSS = CookTorrance([0.3, 0.2, 0.1], 1.0, 0.15)


def samples_of(table: Table, loss: Loss = Loss.LIKELIHOOD) -> TableSamples:
    return TableSamples.of(table, loss, stated_noise(table, 0.01), noise_stated=True)


def scattered(count: int) -> Table:
    """Random directions of unequal solid angles, with many incidences."""
    generator = torch.Generator().manual_seed(0)
    theta = 1.4 * torch.rand(2, count, generator=generator, dtype=torch.float64)
    phi = 2 * math.pi * torch.rand(2, count, generator=generator, dtype=torch.float64)
    wi, wo = from_angles(theta[0], phi[0]), from_angles(theta[1], phi[1])
    measure = (theta[0].sin() * theta[1].sin())[:, None]
    return Table(Path("a"), wi, wo, GLOSS(wi, wo), ("R", "G", "B"), measure=measure / measure.mean())


def test_a_table_fulfils_the_protocol() -> None:
    assert isinstance(samples_of(measured(GLOSS, hemispherical())), Samples)


def test_groups_are_the_incidences() -> None:
    table = measured(GLOSS, hemispherical())
    shuffled = torch.randperm(len(table), generator=torch.Generator().manual_seed(1))
    mixed = Table(table.path, table.wi[shuffled], table.wo[shuffled], table.values[shuffled], table.channels)
    samples = samples_of(mixed)
    assert [one.label for one in samples.incidences] == [f"{angle}°" for angle in range(10, 81, 10)]
    for number, one in enumerate(samples.incidences):
        assert one.theta == pytest.approx(math.radians(10 * (number + 1)))
        torch.testing.assert_close(
            samples.table.wi[one.rows, 2].acos(), torch.full_like(samples.table.wi[one.rows, 2], one.theta)
        )
    assert samples.groups.images == 8
    assert samples.account.counts == [int((samples.labels == number).sum()) for number in range(8)]
    # Rows keep their values.
    torch.testing.assert_close(samples.table.values.sum(0), table.values.sum(0))


def test_many_incidences_are_grouped_in_bands() -> None:
    samples = samples_of(scattered(5_000))
    assert [one.label for one in samples.incidences][:2] == ["0° to 10°", "10° to 20°"]
    assert samples.account.images == range(len(samples.incidences))


def test_the_radiance_is_f_cos_and_its_variance_relative_with_a_floor() -> None:
    table = measured(GLOSS, hemispherical())
    batch = TableSamples.of(table, Loss.LIKELIHOOD, stated_noise(table, 0.02, 0.001), noise_stated=True).rows(
        torch.arange(50)
    )
    torch.testing.assert_close(batch.radiance, table.values[:50] * table.wi[:50, 2:])
    torch.testing.assert_close(batch.variance(batch.radiance), 0.001**2 + (0.02 * batch.radiance).square())


def test_rows_of_less_solid_angle_have_more_variance() -> None:
    samples = samples_of(scattered(1_000))
    batch, measure = samples.rows(slice(0, 100)), samples.table.measure
    assert measure is not None
    plain = samples.noise.floor.square() + (samples.noise.relative * batch.radiance).square()
    torch.testing.assert_close(batch.variance(batch.radiance), plain / measure[:100])


def test_a_small_table_is_its_own_pilot_and_a_large_one_is_sampled() -> None:
    small = samples_of(measured(GLOSS, hemispherical()))
    assert sum(map(len, small.pilot(10_000, 0))) == len(small)
    large = samples_of(scattered(20_000))
    parts = large.pilot(2_000, 0)
    assert 1_500 < sum(map(len, parts)) <= 2_000
    # A sample counts for the rows that it stands for: sums of weights are those of all rows, within chance.
    weights = sum(float(part.weight(torch.ones_like(part.radiance)).sum()) for part in parts)
    everything = large.rows(slice(None))
    assert weights == pytest.approx(float(everything.weight(torch.ones_like(everything.radiance)).sum()), rel=0.05)


def test_tiles_and_batches_give_every_row_once() -> None:
    samples = samples_of(scattered(40_000))
    tiles = [tile() for group in samples.tiles() for tile in group]
    assert len(tiles) == 3
    torch.testing.assert_close(torch.cat([tile.batch.radiance for tile in tiles]), samples.radiance)
    batches = list(samples.batches(9_000, shuffle=True, seed=1))
    torch.testing.assert_close(torch.cat([batch.radiance for batch in batches]).sum(0), samples.radiance.sum(0))
    assert len(list(samples.batches(9_000, skip=2))) == len(batches) - 2


def test_a_table_states_the_wavelengths_of_its_channels() -> None:
    table = measured(Lambert(0.5), hemispherical())
    assert samples_of(table).optics(Role.WAVELENGTH) is None
    named = Table(table.path, table.wi, table.wo, table.values, ("500 nm",), torch.tensor([0.5]))
    assert samples_of(named).optics(Role.WAVELENGTH) == torch.tensor([0.5])
    assert samples_of(named).optics(Role.SOLID_ANGLE) is None


def test_li_and_torrances_cost_is_weighted_by_the_cosine_of_the_incidence() -> None:
    table = measured(GLOSS, hemispherical())
    samples = TableSamples.of(table, Loss.LI_TORRANCE, first_noise(table, Loss.LI_TORRANCE), noise_stated=False)
    batch, model = samples.rows(slice(None)), torch.zeros_like(samples.radiance)
    cost = ((batch.radiance - model).square() * batch.weight(model) * samples.noise.floor.square()).sum()
    torch.testing.assert_close(cost, (table.wi[:, 2:] * table.values.square()).sum())
