"""`matest estimate` of many captures: the same results whoever does them, nothing done twice, a summary."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from matest import batch
from matest.report.summary import Row
from tests.commands.conftest import Run

PLAIN = ("--model", "lambert", "--pictures", "none")


@pytest.fixture
def three(capture: Path, tmp_path: Path) -> list[Path]:
    """Two captures, of different photographs, and one of which a photograph is missing."""
    folder = tmp_path / "captures"
    names = [Path(shutil.copytree(capture, folder / name)) for name in ("bad", "ball", "cup")]
    (names[0] / "01.png").unlink()
    (names[2] / "00.png").write_bytes((names[2] / "01.png").read_bytes())
    return names


def answers(out: Path) -> dict[str, str]:
    """What two runs have in common: results up to the command line and the time."""
    return {file.parent.name: file.read_text("utf-8").partition('"command"')[0] for file in out.glob("*/result.json")}


def test_two_processes_give_the_same_bytes_as_one(run: Run, three: list[Path], tmp_path: Path) -> None:
    codes = [run("estimate", *three, *PLAIN, "--jobs", n, "-o", tmp_path / f"out{n}")[0] for n in (1, 2)]
    assert codes == [2, 2]
    first, second = answers(tmp_path / "out1"), answers(tmp_path / "out2")
    assert set(first) == {"ball", "cup"}
    assert first == second
    assert first["ball"] != first["cup"]


def test_a_summary_has_every_capture_and_the_sentence_of_those_without_result(
    run: Run, three: list[Path], tmp_path: Path
) -> None:
    code, out, err = run("estimate", *three, *PLAIN, "-o", tmp_path / "out")
    assert code == 2
    assert "3 captures: 2 converged, 1 bad input." in out
    assert err.startswith("matest: ")
    assert "01.png: no such file" in err
    rows = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))["captures"]
    assert rows[0]["name"] == "bad"
    assert "01.png: no such file" in rows[0]["error"]
    assert all(row["parameters"]["albedo[0]"][0] > 0 for row in rows[1:])
    assert (tmp_path / "out" / "summary.csv").read_text("utf-8-sig").count("\n") == 4


def test_json_of_many_captures_is_that_of_their_files(run: Run, three: list[Path], tmp_path: Path) -> None:
    _, out, _ = run("estimate", *three, *PLAIN, "-o", tmp_path / "out", "--json")
    content = json.loads(out)
    assert "01.png" in content[str(three[0])]["error"]
    assert content[str(three[1])] == json.loads((tmp_path / "out" / "ball" / "result.json").read_text("utf-8"))


def test_what_is_complete_and_unchanged_is_kept(run: Run, three: list[Path], tmp_path: Path) -> None:
    arguments = ("estimate", *three[1:], *PLAIN, "-o", tmp_path / "out")
    files = [tmp_path / "out" / name / "result.json" for name in ("ball", "cup")]

    def kept(*options: str) -> list[bool]:
        before = [file.stat().st_ino for file in files]
        assert run(*arguments, *options)[0] == 0
        return [file.stat().st_ino == number for file, number in zip(files, before, strict=True)]

    run(*arguments)
    assert kept("--resume") == [True, True]
    alone = ("estimate", three[2], *PLAIN, "-o", tmp_path / "out" / "cup", "--resume", "--json")
    assert json.loads(run(*alone)[1]) == json.loads(files[1].read_text("utf-8"))
    assert kept("--resume", "--seed", "1") == [False, False]
    assert kept("--resume", "--seed", "1") == [True, True]
    (three[1] / "00.png").write_bytes((three[1] / "02.png").read_bytes())
    assert kept("--resume", "--seed", "1") == [False, True]
    (tmp_path / "out" / "cup" / "report.html").write_text("half", "utf-8")
    assert kept("--resume", "--seed", "1") == [True, False]
    assert kept("--seed", "1") == [False, False]


def test_an_interruption_says_what_is_complete_and_keeps_it(
    run: Run, three: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = batch.summarised

    def stopped(job: batch.Job) -> Row:
        if job.name == "cup":
            raise KeyboardInterrupt
        return done(job)

    monkeypatch.setattr(batch, "summarised", stopped)
    code, _, err = run("estimate", *three[1:], *PLAIN, "-o", tmp_path / "out")
    assert code == 1
    assert err == "matest: interrupted; 1 of 2 captures are complete; go on with --resume.\n"
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["ball"]


def test_a_summary_of_somebody_else_is_not_replaced(run: Run, three: list[Path], tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "summary.csv").write_text("mine", "utf-8")
    code, _, err = run("estimate", *three, *PLAIN, "-o", tmp_path / "out")
    assert code == 2
    assert "summary.csv: would be replaced" in err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["summary.csv"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--jobs", "2", "--memory", "300MB"), "--memory 300MB is too little for any capture; give"),
        (("--jobs", "2", "--scheduler", "local"), "leave --jobs and --memory out"),
        (("--memory", "much"), "--memory takes a number with MB or GB, as 800MB or 4GB; got 'much'"),
        (("--scheduler", "tcp:nowhere"), "no Dask scheduler answers there"),
    ],
)
def test_options_that_cannot_be_get_a_sentence(
    run: Run, three: list[Path], tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    code, _, err = run("estimate", *three, *PLAIN, "-o", tmp_path / "out", *options)
    assert code in (1, 2)
    assert words in err
    assert not (tmp_path / "out").exists()


def test_captures_that_need_more_memory_than_a_share_come_last_with_all_of_it(
    three: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def pool(_: object, jobs: list[batch.Job], count: int, memory: int, *_others: object):
        calls.append(([job.name for job in jobs], count, memory))
        for job in jobs:
            yield job, Row(job.name, "failed", error="-", lacks_memory=job.name != "bad" and memory < 2 << 30)

    monkeypatch.setattr(batch, "in_processes", pool)
    jobs = batch.jobs(three, tmp_path / "out", batch.Options(model="lambert"))
    rows = {job.name: row for job, row in batch.run_all(jobs, 2, 3 << 30)}
    share = ((3 << 30) - (400 << 20)) // 2
    assert calls == [(["bad", "ball", "cup"], 2, share), (["ball", "cup"], 1, 2 * share)]
    assert set(rows) == {"bad", "ball", "cup"}
    assert not any(row.lacks_memory for row in rows.values())


@pytest.mark.slow
def test_the_memory_that_is_named_as_the_least_suffices_for_small_captures(
    run: Run, three: list[Path], tmp_path: Path
) -> None:
    arguments = ("estimate", *three[1:], *PLAIN, "-o", tmp_path / "out", "--jobs", "2", "--memory")
    _, _, err = run(*arguments, "300MB")
    least = err.rpartition("give ")[2].split()[0]
    assert run(*arguments, least)[0] == 0
