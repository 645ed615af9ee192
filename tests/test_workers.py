"""Threads and processes: one per processor, results in order, torch as it was before."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

import matest
from matest import workers
from matest.workers import (
    in_groups,
    in_threads,
    limit_processors,
    one_behind,
    processes,
    processors,
    single_threaded_torch,
)

PACKAGE = Path(matest.__file__).parent


@pytest.fixture
def two_torch_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


def slow_at_first(item: int) -> int:
    time.sleep(0.02 if item == 0 else 0)
    return item * item


def test_results_come_in_the_order_of_the_items() -> None:
    assert list(in_threads(slow_at_first, range(5))) == [0, 1, 4, 9, 16]
    assert list(in_groups(lambda item: [slow_at_first(item)], [range(3), [3], [], [4]])) == [0, 1, 4, 9, 16]


def test_an_item_is_made_while_the_one_before_it_is_worked_on_and_no_further_one() -> None:
    working, made = threading.Event(), threading.Event()
    done: list[int] = []

    def items() -> Iterator[int]:
        yield 0
        assert working.wait(5)
        made.set()
        yield 1
        assert done[0] == 0

    def work(item: int) -> None:
        working.set()
        assert made.wait(5)
        done.append(item)

    one_behind(work, items())
    assert done == [0, 1]


def test_an_error_behind_ends_the_work() -> None:
    with pytest.raises(ZeroDivisionError):
        one_behind(lambda item: 1 // item, [1, 0, 1])


def test_no_more_threads_work_than_there_are_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "processors", lambda: 3)
    meeting = threading.Barrier(3, timeout=10)

    def name(_: int) -> str:
        # Three have to be here at once: passed only where three threads work.
        meeting.wait()
        return threading.current_thread().name

    assert len({*in_threads(name, range(12))}) == 3


def test_threads_may_start_threads() -> None:
    rows = in_threads(lambda row: list(in_threads(lambda column: (row, column), range(4))), range(8))
    assert list(rows) == [[(row, column) for column in range(4)] for row in range(8)]


def test_a_group_is_not_drawn_before_the_one_before_it_is_done() -> None:
    done: list[int] = []

    def groups() -> Iterator[range]:
        for start in (0, 3, 6):
            assert sorted(done) == list(range(start))
            yield range(start, start + 3)

    def work(item: int) -> list[int]:
        done.append(item)
        return [item] * (item % 2)

    assert list(in_groups(work, groups())) == [1, 3, 5, 7]


@pytest.mark.usefixtures("two_torch_threads")
def test_torch_runs_on_the_thread_that_calls_it_and_gets_its_threads_back_after_an_error() -> None:
    def count(item: int) -> list[int]:
        if item == 3:
            raise KeyError(item)
        return [torch.get_num_threads()]

    for work in (in_threads(count, range(4)), in_groups(count, [range(4)])):
        found = []
        with pytest.raises(KeyError, match="3"):
            found.extend(iter(work))
        assert torch.get_num_threads() == 2
    assert next(iter(in_threads(count, [0]))) == [1]


@pytest.mark.usefixtures("two_torch_threads")
def test_estimates_side_by_side_leave_torch_its_threads() -> None:
    inside, out = threading.Event(), threading.Event()

    def other() -> None:
        with single_threaded_torch():
            inside.set()
            out.wait(10)

    thread = threading.Thread(target=other)
    with single_threaded_torch():
        thread.start()
        inside.wait(10)
        with single_threaded_torch():
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 1
    out.set()
    thread.join()
    assert torch.get_num_threads() == 2


@pytest.mark.usefixtures("two_torch_threads")
def test_torch_gets_its_threads_back_even_after_an_error() -> None:
    def fail() -> None:
        with single_threaded_torch():
            assert torch.get_num_threads() == 1
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert torch.get_num_threads() == 2


def remember(word: str) -> None:
    os.environ["MATEST_TEST_WORD"] = word


def remembered(_: int) -> tuple[int, str]:
    return os.getpid(), os.environ["MATEST_TEST_WORD"]


def test_processes_are_fresh_prepared_and_no_more_than_asked_for() -> None:
    with processes(1, remember, "ready") as pool:
        found = list(pool.map(remembered, range(3)))
    assert len({*found}) == 1
    assert found[0][0] != os.getpid()
    assert found[0][1] == "ready"
    assert "MATEST_TEST_WORD" not in os.environ


def test_processors_are_those_that_this_process_may_use() -> None:
    assert 1 <= processors() <= (os.cpu_count() or 1)


@pytest.mark.usefixtures("two_torch_threads")
def test_who_works_beside_others_uses_its_share(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_share", None)
    limit_processors(1)
    assert (processors(), torch.get_num_threads()) == (1, 1)
    limit_processors(1000)
    assert processors() <= (os.cpu_count() or 1)


def files_with(*words: str) -> list[str]:
    """Files of the package in which one of the words stands."""
    return sorted(
        str(file.relative_to(PACKAGE))
        for file in PACKAGE.rglob("*.py")
        if any(word in file.read_text("utf-8") for word in words)
    )


def test_nothing_else_in_the_package_sizes_a_pool_of_its_own() -> None:
    assert files_with("PoolExecutor", "cpu_count", "sched_getaffinity") == ["workers.py"]


def test_processes_are_handled_by_those_that_share_captures_out_and_where_readers_are_tried() -> None:
    assert files_with("import multiprocessing", "from multiprocessing") == [
        "benchmark/instruments/endurance.py",
        "cluster.py",
        "pool.py",
        "workers.py",
    ]
