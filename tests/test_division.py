"""One capture over several processes: the same result, whatever happens to them."""

from __future__ import annotations

import contextlib
import math
import os
import pickle
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cloudpickle
import cv2
import numpy as np
import pytest

import matest
from matest import batch, cluster, division
from matest.batch import Job, Options
from matest.benchmark.instruments import faults
from matest.benchmark.instruments.laboratory import children, until
from matest.brdf import OrenNayar
from matest.capture import Capture, load_capture
from matest.errors import InputError, WorkError
from matest.photographs.file_images import FileImages
from matest.simulate import simulate
from tests import scenes
from tests.dask_ends import Future, KilledWorker
from tests.signalled import hearing

ADDRESS = "tcp://a:1"


class Client:
    """Does at once what it is given, as two workers would: with what comes through bytes.

    Attributes:
        placed: what workers were sent.
        submitted: number of blocks.
        fate: the end of a block that is not done, by its number; None: it is done.
    """

    def __init__(self, fate: Callable[[int], Future | None] = lambda _: None) -> None:
        self.placed: list[Any] = []
        self.submitted = 0
        self.fate = fate

    def nthreads(self) -> dict[str, int]:
        return {"b": 1, "a": 1}

    def scatter(self, source: object, **_: object) -> object:
        self.placed.append(cloudpickle.loads(cloudpickle.dumps(source)))
        return self.placed[-1]

    def submit(self, function: Callable, *arguments: object, **_: object) -> Future:
        self.submitted += 1
        return self.fate(self.submitted) or Future("finished", function(*arguments))


@pytest.fixture
def divided(monkeypatch: pytest.MonkeyPatch) -> Callable[[Client], contextlib.AbstractContextManager[None]]:
    """Let a client do the passes inside; its scheduler answers."""
    monkeypatch.setattr(cluster, "_completed", lambda _, futures: [*futures])
    monkeypatch.setattr(cluster, "is_reachable", lambda _: True)
    # Workers alone do that.
    monkeypatch.setattr(division, "limit_processors", lambda _: None)

    @contextlib.contextmanager
    def inside(client: Client) -> Iterator[None]:
        monkeypatch.setattr(division, "_division", division.Division(client, ADDRESS))
        yield
        monkeypatch.setattr(division, "_division", None)

    return inside


def answer(capture: Capture, **options: Any) -> dict[str, Any]:
    content = matest.estimate(capture, **options).to_dict()
    del content["timing_s"]
    return content


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four coloured photographs of a ball."""
    folder = tmp_path_factory.mktemp("ball")
    material = scenes.material("oren-nayar", albedo=[0.6, 0.5, 0.4], sigma=0.4)
    scenes.write(folder / "scene", material, scenes.sphere(64), scenes.noise(), scenes.distant(scenes.LIGHTS[:4]))
    return simulate(folder / "scene", folder / "ball")


@pytest.fixture(scope="module")
def slab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three grey photographs, in files for colours, of a mesh with shadows under near lights."""
    folder = tmp_path_factory.mktemp("slab")
    camera = '[camera]\nkind = "orthographic"\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nup = [0, 1, 0]\nheight = 3.2\n'
    lights = scenes.near(([0.3, 0.2, 4.0], [2.5, 0.5, 3.0], [-2.0, 1.0, 3.0]), 30.0)
    scenes.write(
        folder / "scene",
        scenes.material("oren-nayar", albedo=0.5, sigma=0.4),
        scenes.notched_mesh(folder / "scene"),
        camera + "resolution = [96, 96]\n",
        scenes.noise(),
        lights,
    )
    capture = simulate(folder / "scene", folder / "slab")
    for file in capture.glob("0*.png"):
        grey = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(file), np.repeat(grey.reshape(*grey.shape[:2], -1)[..., :1], 3, axis=2))
    return capture


@pytest.mark.parametrize(
    "options",
    [
        {"model": "oren-nayar"},
        {"model": "lambert+cook-torrance"},
        {"model": "oren-nayar", "refine": "direction,normals"},
    ],
    ids=lambda options: "-".join(options.values()),
)
def test_a_capture_over_two_workers_has_the_result_of_one_process(ball: Path, divided: Any, options: dict) -> None:
    client = Client()
    with divided(client):
        over_two = answer(load_capture(ball), **options)
    assert client.submitted
    assert over_two == answer(load_capture(ball), **options)


def test_so_has_a_mesh_with_shadows_in_grey_photographs(slab: Path, divided: Any) -> None:
    client = Client()
    with divided(client):
        over_two = answer(load_capture(slab), model="oren-nayar")
    assert client.submitted
    assert client.placed[0].photographs.channels == 1
    assert over_two == answer(load_capture(slab), model="oren-nayar")


def test_pixels_stay_where_they_are_and_workers_read_files(ball: Path) -> None:
    samples = load_capture(ball).photographs.samples()
    stored = samples.photographs.stored
    assert isinstance(stored, FileImages)
    images_alone = pickle.dumps(stored)
    elsewhere = pickle.loads(images_alone)
    assert len(images_alone) < sum(pixels.nbytes for pixels in stored) / 2
    assert elsewhere._arrays == [None] * 4
    np.testing.assert_array_equal(elsewhere[2], stored[2])
    assert [array is None for array in elsewhere._arrays] == [True, True, False, True]
    some = np.arange(len(stored[0])) % 3 == 0
    for part in (stored.take(some), stored.first_channel(), stored.first_channel().take(some)):
        for here, there in zip(part, pickle.loads(pickle.dumps(part)), strict=True):
            np.testing.assert_array_equal(here, there)


def test_photographs_that_no_file_holds_are_not_divided(ball: Path, divided: Any) -> None:
    capture = load_capture(ball)
    in_memory = replace(capture, photographs=replace(capture.photographs, stored=tuple(capture.photographs.stored)))
    client = Client()
    with divided(client):
        answer(in_memory, model="lambert")
    assert not client.submitted


def test_a_single_photograph_is_not_divided(ball: Path, divided: Any) -> None:
    client = Client()
    with divided(client):
        matest.predict(OrenNayar(albedo=0.5, sigma=0.3), load_capture(ball))
    assert not client.submitted


def test_a_file_that_changed_before_a_worker_reads_it_is_refused(ball: Path, tmp_path: Path, divided: Any) -> None:
    folder = Path(shutil.copytree(ball, tmp_path / "ball"))
    capture = load_capture(folder)
    shutil.copy(folder / "01.png", folder / "02.png")
    with divided(Client()), pytest.raises(InputError, match=r"02\.png: expected the image that was read before"):
        matest.estimate(capture, model="lambert")


def test_what_went_with_a_worker_is_sent_again(ball: Path, divided: Any) -> None:
    client = Client(lambda number: Future("cancelled") if number in (1, 2) else None)
    with divided(client):
        over_two = answer(load_capture(ball), model="oren-nayar")
    assert len(client.placed) == 2
    assert over_two == answer(load_capture(ball), model="oren-nayar")


@pytest.mark.parametrize("end", [Future("cancelled"), Future("error", KilledWorker())])
def test_workers_that_die_again_and_again_end_the_estimate_with_a_sentence(
    ball: Path, divided: Any, end: Future
) -> None:
    with divided(Client(lambda _: end)), pytest.raises(WorkError, match="were lost, one after another; often memory"):
        matest.estimate(load_capture(ball), model="lambert")


def test_a_scheduler_that_is_lost_ends_the_command_with_the_sentence(
    ball: Path, tmp_path: Path, divided: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "is_reachable", lambda _: False)
    lost = pytest.raises(WorkError, match=r"--scheduler tcp://a:1: the scheduler was lost\.")
    with divided(Client(lambda _: Future("cancelled"))), lost:
        batch.run(Job(ball, tmp_path / "out", Options(model="lambert")))
    assert [*tmp_path.iterdir()] == []


def of_files(folder: Path) -> str:
    """What runs of one capture have in common."""
    return (folder / "result.json").read_text("utf-8").partition('"command"')[0]


@pytest.fixture(scope="module")
def twelve(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve photographs of 256×256 pixels."""
    folder = tmp_path_factory.mktemp("twelve")
    material = scenes.material("oren-nayar", albedo=[0.6, 0.5, 0.4], sigma=0.4)
    lights = tuple([0.8 * math.cos(k), 0.8 * math.sin(k), 0.6] if k % 2 else [0.1 * k, 0.2, 1.0] for k in range(12))
    scenes.write(folder / "scene", material, scenes.sphere(256), scenes.noise(), scenes.distant(lights))
    return simulate(folder / "scene", folder / "ball")


def command(capture: Path, out: Path, *options: str) -> list[str]:
    some = ["--model", "oren-nayar", "--refine", "direction", "--pictures", "none"]
    return [sys.executable, "-m", "matest", "estimate", str(capture), *some, "-o", str(out), *options]


@contextlib.contextmanager
def at_work(capture: Path, out: Path) -> Iterator[tuple[subprocess.Popen[str], str, subprocess.Popen, int]]:
    """A command on a capture, the address and the process of its scheduler, and one of two workers, which has begun."""
    out.parent.mkdir(exist_ok=True)
    with faults._cluster() as (address, scheduler, workers):
        until(lambda: len(children(workers.pid)) == 2)
        some = children(workers.pid)
        process = hearing(command(capture, out, "--scheduler", address))
        until(lambda: any(has_samples(worker) for worker in some) or process.poll() is not None)
        yield process, address, scheduler, next(worker for worker in some if has_samples(worker))
        process.wait(300)


def has_samples(worker: int) -> bool:
    """Whether a worker has loaded what samples are made of: nothing else that Dask asks of it needs that."""
    return "libtorch" in Path(f"/proc/{worker}/maps").read_text("utf-8")


@pytest.mark.slow
def test_two_workers_give_the_same_bytes_also_where_one_is_killed(twelve: Path, tmp_path: Path) -> None:
    outs = [tmp_path / name for name in ("alone", "two", "killed")]
    subprocess.run(command(twelve, outs[0]), check=True, capture_output=True)
    with at_work(twelve, outs[1]) as (process, *_):
        assert process.wait(300) == 0
    with at_work(twelve, outs[2]) as (process, _, _, worker):
        os.kill(worker, signal.SIGKILL)
        assert process.wait(300) == 0
    assert of_files(outs[0]) == of_files(outs[1]) == of_files(outs[2])


@pytest.mark.slow
def test_without_its_scheduler_the_command_says_so_and_leaves_nothing(twelve: Path, tmp_path: Path) -> None:
    out = tmp_path / "results" / "out"
    with at_work(twelve, out) as (process, address, scheduler, _):
        scheduler.kill()
        _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    complete = "0 of 1 captures are complete; go on with --resume."
    assert errors.splitlines() == [f"matest: --scheduler {address}: the scheduler was lost. {complete}"]
    assert [*out.parent.iterdir()] == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_says_so_and_leaves_nothing(twelve: Path, tmp_path: Path, kind: int) -> None:
    out = tmp_path / "results" / "out"
    with at_work(twelve, out) as (process, *_):
        process.send_signal(kind)
        _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert errors.splitlines() == ["matest: interrupted; 0 of 1 captures are complete; go on with --resume."]
    assert [*out.parent.iterdir()] == []
