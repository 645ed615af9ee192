"""Captures of one command: a job each, which other processes can do, and its outcome."""

from __future__ import annotations

import json
import os
import pickle
import shutil
from pathlib import Path

import pytest

from matest import batch
from matest.batch import Job, Outcome
from matest.estimation.options import Options
from matest.report.picture_size import PictureSize
from matest.simulate import simulate
from matest.workers import processes
from tests import scenes
from tests.captures import refusal

LAMBERT = Options(model="lambert")


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ball")
    material = scenes.material("lambert", albedo=0.5)
    scenes.write(folder / "scene", material, scenes.sphere(32), scenes.noise(), scenes.distant(scenes.LIGHTS[:2]))
    return simulate(folder / "scene", folder / "ball")


@pytest.fixture
def two(ball: Path, tmp_path: Path) -> list[Path]:
    """A capture of which a photograph is missing, and a good one."""
    bad, good = (Path(shutil.copytree(ball, tmp_path / name)) for name in ("bad", "good"))
    (bad / "01.png").unlink()
    return [bad, good]


def run_elsewhere(job: Job) -> tuple[int, Outcome]:
    return os.getpid(), batch.run(job)


def test_a_job_and_its_outcome_travel_to_another_process_and_back(two: list[Path], tmp_path: Path) -> None:
    jobs = batch.jobs(two, tmp_path / "out", LAMBERT, "matest estimate bad good")
    with processes(1) as pool:
        (process, bad), (_, good) = pool.map(run_elsewhere, jobs)
    assert process != os.getpid()
    assert [bad.job, good.job] == jobs
    assert good.estimate is not None
    written = json.loads((tmp_path / "out" / "good" / "result.json").read_text("utf-8"))
    assert good.estimate.to_dict() == written
    assert written["provenance"]["command"] == "matest estimate bad good"
    there = tmp_path / "out" / "good" / written["provenance"]["capture"]
    assert there.samefile(two[1])
    assert (tmp_path / "out" / "good" / written["provenance"]["root"]).samefile(tmp_path)
    assert not (tmp_path / "out" / "bad").exists()


def test_a_job_says_which_pictures_to_draw(ball: Path, tmp_path: Path) -> None:
    (job,) = batch.jobs([ball], tmp_path / "out", LAMBERT, pictures=PictureSize.NONE)
    assert pickle.loads(pickle.dumps(job)) == job
    assert batch.run(job).status == "estimated"
    assert not (tmp_path / "out" / "images").exists()


def test_bad_input_is_an_outcome_with_its_sentence_and_exit_code(two: list[Path], tmp_path: Path) -> None:
    bad, good = (batch.run(job) for job in batch.jobs(two, tmp_path / "out", LAMBERT))
    assert (bad.status, bad.exit_code, bad.estimate) == ("bad input", 2, None)
    assert "01.png: no such file" in bad.error
    assert (good.status, good.exit_code, good.error) == ("estimated", 0, "")
    assert pickle.loads(pickle.dumps(bad)) == bad


def test_what_is_done_is_told_job_by_job(ball: Path, tmp_path: Path) -> None:
    words: list[str] = []
    (job,) = batch.jobs([ball], tmp_path / "out", LAMBERT)
    batch.run(job, lambda what, *_: words.append(what))
    assert words[0] == "reading images"
    assert "searching" in words
    assert words[-1] == "writing the report"


def test_results_lie_in_their_captures_or_in_folders_of_their_names(two: list[Path], tmp_path: Path) -> None:
    bad, good = two
    file = good / "capture.toml"

    def places(captures: list[Path], out: Path | None) -> list[Path]:
        return [job.out for job in batch.jobs(captures, out, LAMBERT)]

    assert places([good], None) == places([file], None) == [good / "matest"]
    assert places([good], tmp_path / "out") == [tmp_path / "out"]
    assert places([bad, file], None) == [bad / "matest", good / "matest"]
    assert places([bad, file], tmp_path / "out") == [tmp_path / "out" / "bad", tmp_path / "out" / "good"]
    assert places([bad, good, bad], None) == [bad / "matest", good / "matest"]
    assert "same name (good)" in refusal(lambda: batch.jobs([good, file], tmp_path / "out", LAMBERT))


def test_captures_of_one_command_may_share_files_beside_them(two: list[Path], tmp_path: Path) -> None:
    bad, good = two
    assert [job.root for job in batch.jobs([bad, good], None, LAMBERT)] == [tmp_path, tmp_path]
    assert [job.root for job in batch.jobs([good / "capture.toml"], None, LAMBERT)] == [good]
    (good / "00.png").rename(tmp_path / "shared.png")
    text = (good / "capture.toml").read_text("utf-8")
    (good / "capture.toml").write_text(text.replace('"00.png"', '"../shared.png"'), "utf-8")
    alone, among = batch.jobs([good], None, LAMBERT)[0], batch.jobs([bad, good], None, LAMBERT)[1]
    assert "outside" in batch.run(alone).error
    assert batch.run(among).status == "estimated"


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(28, "No space left on device", "out"), "out: No space left on device."),
        (MemoryError(), "there is not enough memory"),
        (ZeroDivisionError("division by zero"), "this is a fault of matest, please report it: ZeroDivisionError"),
    ],
)
def test_work_that_fails_is_an_outcome(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, error: Exception, words: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(batch, "load_capture", fail)
    outcome = batch.run(Job(tmp_path, tmp_path / "out", Options()))
    assert (outcome.status, outcome.exit_code) == ("failed", 1)
    assert words in outcome.error


def test_a_place_that_cannot_be_written_to_is_told_before_the_capture_is_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(batch, "load_capture", lambda *_, **__: pytest.fail("it was read"))
    outcome = batch.run(Job(tmp_path, Path("/proc/out"), Options()))
    assert (outcome.status, outcome.exit_code) == ("failed", 1)
    assert "nothing can be written there" in outcome.error
