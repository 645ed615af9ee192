"""`matest benchmark` as people and scripts use it."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from matest import benchmark, cli
from matest.benchmark import suites
from matest.benchmark.instruments import passes
from matest.benchmark.suite import Progress, Record
from matest.benchmark.suites import frontier, limits, models, peers, stress

# The suites of the estimator have tests of their own.
OF_MODELS = ("models", "stress")
VARIANTS = ["lambert", "cook-torrance(normalisation=paper1982)"]
FIELDS = {"suite": str, "case": str, "metric": str, "unit": str, "better": str}


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]):
    """Run `matest benchmark ARGUMENTS` on two models, small: exit code, standard output, standard error."""
    monkeypatch.setattr(models, "PAIRS_QUICK", 1000)
    monkeypatch.setattr(stress, "POINTS_QUICK", 1000)
    monkeypatch.setattr(passes, "SPELL", 0.0)
    monkeypatch.setattr(limits, "machine", lambda: limits.Limits(1e-10, 1e-7, 1e-9, 1e-9))
    monkeypatch.setattr(models, "MODELS", VARIANTS)
    monkeypatch.setenv("COLUMNS", "80")
    for suite in (models, stress):
        monkeypatch.setattr(suite, "variants", lambda: VARIANTS)

    def invoke(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["matest", "benchmark", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capfd.readouterr()
        return int(ended.value.code or 0), out, err

    return invoke


def test_json_is_one_record_a_line(run) -> None:
    code, out, err = run("--quick", "--json", "--suite", ",".join(OF_MODELS))
    assert (code, err) == (0, "")
    records = [json.loads(line) for line in out.splitlines()]
    assert {record["suite"] for record in records} == {"limits", *OF_MODELS}
    for record in records:
        assert set(record) == {*FIELDS, "value", "limit"}
        assert all(isinstance(record[name], kind) for name, kind in FIELDS.items())
        assert isinstance(record["value"], (int, float))
        assert record["limit"] is None or isinstance(record["limit"], (int, float))
        assert record["better"] in ("lower", "higher")
    names = [(record["suite"], record["case"], record["metric"]) for record in records]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("suite", OF_MODELS)
def test_tables_fit_an_eighty_column_terminal_and_cut_nothing_off(run, suite: str) -> None:
    code, out, err = run("--quick", "--suite", suite)
    assert (code, err) == (0, "")
    assert "cook-torrance" in out
    assert "paper1982" in out
    assert "…" not in out
    assert max(len(line.rstrip()) for line in out.splitlines()) <= 80


@pytest.mark.parametrize(("given", "hint"), [("stres", "did you mean 'stress'?"), ("models,xyz", "known are models")])
def test_unknown_suite_gets_one_sentence_and_exit_2(run, given: str, hint: str) -> None:
    code, out, err = run("--suite", given)
    assert code == 2
    assert out == ""
    assert len(err.splitlines()) == 1
    assert hint in err


def test_help_has_an_example_and_names_every_suite(run) -> None:
    code, out, _ = run("--help")
    assert code == 0
    assert "Example: matest benchmark" in out
    assert all(name in out for name in benchmark.SUITES)


def test_what_misses_its_limit_is_told_with_its_place(run, monkeypatch: pytest.MonkeyPatch) -> None:
    def examine(brdf: object, points: int, *others: object) -> list[Record]:
        found = stress_examine(brdf, points, *others)
        return [*found[:-1], Record("stress", found[-1].case, "float32 error", 1e30, "1", limit=1, note="wi = here")]

    stress_examine = stress.examine
    monkeypatch.setattr(stress, "examine", examine)
    code, out, _ = run("--quick", "--suite", "stress")
    assert code == 0
    assert "lambert: float32 error = 1e+30, limit 1" in out
    assert "wi = here" in out
    assert "…" not in out


@pytest.mark.parametrize(
    ("value", "better", "limit", "misses"),
    [(2, "lower", 1, True), (1, "lower", 1, False), (2, "higher", 3, True), (2, "higher", None, False)],
)
def test_record_knows_the_wrong_side_of_its_limit(value: float, better: str, limit: float | None, misses: bool) -> None:
    assert Record("s", "c", "m", value, "1", better, limit).misses is misses  # type: ignore[arg-type]


def test_against_races_the_peers_that_are_named(run, monkeypatch: pytest.MonkeyPatch) -> None:
    raced: dict[str, tuple[str, ...]] = {}

    def race(name: str) -> benchmark.Suite:
        def measure(effort: benchmark.Effort, _progress: Progress) -> Iterator[Record]:
            raced[name] = effort.against
            yield Record(name, "case", "metric", 1.0, "1")

        return benchmark.Suite(measure, str)

    for name, suite in (("peers", peers), ("frontier", frontier)):
        monkeypatch.setattr(suite, "SUITE", race(name))
    for arguments in (("--against", "adam, l-bfgs"), ("--against", "mitsuba", "--suite", "frontier,stress")):
        code, _, err = run("--quick", "--json", *arguments)
        assert (code, err) == (0, "")
    assert raced == {"peers": ("adam", "l-bfgs"), "frontier": ("mitsuba",)}


DUMMY = """
from rich.text import Text

from matest.benchmark.suite import Record, Suite


def measure(effort, progress):
    progress("counting")
    yield Record("dummy", "case", "quick", int(effort.quick), "1")


SUITE = Suite(measure, lambda records: Text(f"{len(records)} of a dummy"), share=10)
"""


def test_a_new_suite_is_one_file_and_one_line(run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "dummy.py").write_text(DUMMY, "utf-8")
    monkeypatch.setattr(suites, "__path__", [*suites.__path__, str(tmp_path)])
    monkeypatch.setitem(benchmark.SUITES, "dummy", "nothing")
    code, out, err = run("--quick", "--suite", "dummy", "--json")
    assert (code, err) == (0, "")
    assert [json.loads(line) for line in out.splitlines()][-1] == Record("dummy", "case", "quick", 1, "1").to_dict()
    assert "1 of a dummy" in run("--suite", "dummy")[1]
    assert benchmark.plan("")[0][-1] == "dummy"


def test_every_file_of_the_suites_with_a_suite_is_in_the_catalogue() -> None:
    files = {path.stem for path in Path(*suites.__path__).glob("*.py") if "SUITE = " in path.read_text("utf-8")}
    assert files == {benchmark.FIRST, *benchmark.SUITES}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--against", "adm"), "unknown peer 'adm'; did you mean 'adam'"),
        (
            ("--against", "adam", "--suite", "stress"),
            "--against goes with --suite peers or frontier; got --suite stress",
        ),
    ],
)
def test_peers_that_cannot_be_raced_are_refused(run, arguments: tuple[str, ...], sentence: str) -> None:
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert sentence in err.replace("\n", " ")
