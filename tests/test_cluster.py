"""Dask: the same results as without, a worker less or not, and a plain word where there is none."""

from __future__ import annotations

import builtins
import contextlib
import multiprocessing
import time
from typing import Any

import pytest

from matest import cluster
from matest.cluster import in_cluster
from matest.errors import WorkError
from matest.pool import Lost
from tests.captures import refusal
from tests.dask_ends import Future, KilledWorker


def test_every_end_of_a_task_has_its_meaning() -> None:
    assert cluster._result(Future("finished", 5), "tcp://a:1") == 5
    assert isinstance(cluster._result(Future("error", KilledWorker()), "tcp://a:1"), Lost)
    with pytest.raises(WorkError, match=r"tcp://a:1: the scheduler was lost\."):
        cluster._result(Future("lost"), "tcp://a:1")
    with pytest.raises(WorkError, match=r"its workers cannot do it .ModuleNotFoundError: No module named 'matest'.*"):
        cluster._result(Future("error", ModuleNotFoundError("No module named 'matest'")), "tcp://a:1")


def test_without_dask_the_way_to_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    present = builtins.__import__

    def absent(name: str, *rest: Any) -> Any:
        if name.startswith("dask"):
            raise ImportError(name)
        return present(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    assert 'pip install "matest-brdf[cluster]"' in refusal(lambda: [*in_cluster(str, [1], "local")])


@pytest.mark.slow
def test_workers_of_this_machine_give_every_item_its_result() -> None:
    assert dict(in_cluster(str, range(5), "local")) == {number: str(number) for number in range(5)}


@pytest.mark.slow
def test_what_ends_early_leaves_no_worker_that_runs() -> None:
    before = multiprocessing.active_children()
    with contextlib.closing(in_cluster(time.sleep, [0, 1000, 1000], "local")) as done:  # type: ignore[type-var]
        assert next(done) == (0, None)
        assert len(multiprocessing.active_children()) > len(before)
    assert multiprocessing.active_children() == before
