"""Places of results: one run at a time, whole or not at all, and nothing left of runs that were killed."""

from __future__ import annotations

import errno
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from matest import places
from matest.errors import WorkError
from matest.places import reserved, sweep, whole_file, whole_files, whole_folder

# Reserves a place, says so, and waits.
OTHER_RUN = """
import sys
from pathlib import Path
from matest.places import reserved, whole_folder
with whole_folder(Path(sys.argv[1])) as part:
    (part / "half.txt").write_text("half")
    print("here", flush=True)
    sys.stdin.read()
"""


@contextmanager
def another_run(out: Path) -> Iterator[subprocess.Popen]:
    """A process that is writing a folder; it is killed at the end."""
    command = [sys.executable, "-c", OTHER_RUN, str(out)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        try:
            yield process
        finally:
            process.kill()


def tree(path: Path) -> dict[str, bytes]:
    """Every file below a folder, hidden ones too."""
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """An earlier result."""
    (tmp_path / "matest").mkdir()
    (tmp_path / "matest" / "result.json").write_text("old")
    return tmp_path / "matest"


def fail_inside(out: Path, error: type[BaseException] = RuntimeError) -> None:
    with whole_folder(out) as temporary:
        (temporary / "half.txt").write_text("half")
        raise error


def test_a_folder_appears_when_its_block_ends(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "er" / "matest"
    with whole_folder(out) as temporary:
        (temporary / "result.json").write_text("{}")
        assert not out.exists()
        assert temporary.parent == out.parent
    assert tree(tmp_path / "deep") == {"er/matest/result.json": b"{}"}


def test_a_new_folder_takes_the_place_of_the_old_one_whole(tmp_path: Path) -> None:
    out = tmp_path / "matest"
    out.mkdir()
    (out / "result.json").write_text("old")
    (out / "stale.png").write_text("old")
    with whole_folder(out) as temporary:
        (temporary / "result.json").write_text("new")
    assert tree(tmp_path) == {"matest/result.json": b"new"}


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_an_error_leaves_the_old_result_and_no_temporary_folder(tmp_path: Path, error: type[BaseException]) -> None:
    out = tmp_path / "matest"
    out.mkdir()
    (out / "result.json").write_text("old")
    with pytest.raises(error):
        fail_inside(out, error)
    assert tree(tmp_path) == {"matest/result.json": b"old"}
    assert [path.name for path in tmp_path.iterdir()] == ["matest"]


def test_an_error_without_an_old_result_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError):
        fail_inside(tmp_path / "matest")
    assert list(tmp_path.iterdir()) == []


def test_others_may_read_the_folder(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "matest"):
        pass
    assert stat.S_IMODE((tmp_path / "matest").stat().st_mode) == 0o755


@pytest.mark.parametrize("exchange", [True, False])
def test_an_earlier_folder_is_replaced_also_where_the_disk_exchanges_no_names(
    old: Path, monkeypatch: pytest.MonkeyPatch, exchange: bool
) -> None:
    if not exchange:
        monkeypatch.setattr(places, "_exchanged", lambda *_: False)
    with whole_folder(old) as part:
        (part / "result.json").write_text("new")
    assert tree(old.parent) == {"matest/result.json": b"new"}


def test_an_error_while_taking_the_place_brings_the_old_folder_back(old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replace = Path.replace

    def full(source: Path, target: Path) -> Path:
        if source.name.endswith("part"):
            raise OSError(errno.ENOSPC, "disk full")
        return replace(source, target)

    def write() -> None:
        with whole_folder(old) as part:
            (part / "result.json").write_text("new")
            monkeypatch.setattr(Path, "replace", full)

    monkeypatch.setattr(places, "_exchanged", lambda *_: False)
    with pytest.raises(OSError, match="disk full"):
        write()
    assert tree(old.parent) == {"matest/result.json": b"old"}


def test_files_move_together_into_a_folder_whose_others_stay(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "index").write_text("old")
    with whole_files(tmp_path, last="index") as part:
        (part / "images").mkdir()
        (part / "images" / "00").write_text("pixels")
        (part / "index").write_text("new")
        assert (tmp_path / "index").read_text() == "old"
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")} == {
        "notes.txt",
        "index",
        "images",
        "images/00",
    }
    assert (tmp_path / "index").read_text() == "new"


def test_an_error_of_the_disk_names_the_folder_and_leaves_nothing(tmp_path: Path) -> None:
    def fill() -> None:
        with whole_files(tmp_path / "out", last="index") as part:
            (part / "index").write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left") as caught:
        fill()
    assert caught.value.filename == str(tmp_path / "out")
    assert not [*tmp_path.iterdir()]


def test_files_go_where_a_link_leads(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("real")
    with whole_files(tmp_path / "link", last="b") as part:
        (part / "b").write_text("1")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "b").read_text() == "1"


def test_a_second_run_is_refused_in_a_sentence_and_the_first_goes_on(old: Path) -> None:
    with another_run(old) as other:
        with pytest.raises(WorkError, match=r"another run of matest is writing there; wait until it ends"):
            whole_folder(old).__enter__()
        sweep(old)
        other.communicate("")
    assert tree(old.parent) == {"matest/half.txt": b"half"}


def test_what_a_killed_run_left_goes_with_the_next(old: Path) -> None:
    with another_run(old):
        pass
    assert ".matest.matest-part/half.txt" in tree(old.parent)
    sweep(old)
    assert tree(old.parent) == {"matest/result.json": b"old"}


def test_files_of_a_killed_run_go_with_the_next_and_other_hidden_ones_stay(tmp_path: Path) -> None:
    (tmp_path / ".part-mine").mkdir()
    # It is writing a folder of that name, for which it makes the same place.
    with another_run(tmp_path / "index"):
        with pytest.raises(WorkError, match="another run of matest"):
            whole_files(tmp_path, last="index").__enter__()
        assert ".index.matest-part/half.txt" in tree(tmp_path)
    with whole_files(tmp_path, last="index") as part:
        (part / "index").write_text("new")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".part-mine", "index"]


def test_what_a_killed_run_had_put_aside_comes_back(old: Path) -> None:
    old.rename(old.with_name(".matest.matest-old"))
    with reserved(old):
        assert tree(old) == {"result.json": b"old"}
    assert [path.name for path in old.parent.iterdir()] == ["matest"]


def test_who_has_a_place_may_reserve_it_again(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with reserved(out), whole_folder(out) as part:
        (part / "a").write_text("1")
    assert tree(tmp_path) == {"deep/out/a": b"1"}


def test_folders_that_were_made_in_vain_are_removed(tmp_path: Path) -> None:
    with reserved(tmp_path / "deep" / "er" / "out"):
        pass
    assert [*tmp_path.iterdir()] == []


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "summary.csv"
    whole_file(file, b"old")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "disk full", "other")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="disk full") as caught:
        whole_file(file, b"new")
    assert caught.value.filename == str(file)
    assert tree(tmp_path) == {"summary.csv": b"old"}
