"""The command `matest`."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import matest
from matest.commands import arguments
from matest.commands.benchmark import benchmark
from matest.commands.check import check
from matest.commands.console import Say, console, note, print_json, progress
from matest.errors import InputError

if TYPE_CHECKING:
    from matest.capture import Capture
    from matest.estimation.result import Estimate

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,  # boxes around the help would take longer than the help
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="What a surface is made of, with error bars, from photographs of an object whose shape and lights are known.",
)

Json = arguments.Json
Transfer = arguments.Transfer
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Where to write.", show_default=False)]

# Of typer's own in some versions, of click in others.
_UsageError: Any = typer.BadParameter.__base__
# What typer makes of a KeyboardInterrupt.
_INTERRUPTED = 130

app.command(epilog="Example: matest check renders/vase --model oren-nayar --at sigma=0.5")(check)
app.command(epilog="Example: matest benchmark --suite stress --quick")(benchmark)


def main() -> None:
    """Run the command: exit code 0, 1 (the work failed) or 2 (bad input)."""
    try:
        code = app(prog_name="matest", standalone_mode=False)
    except InputError as error:
        _fail(str(error), 2)
    except _UsageError as error:
        _fail(f"{error.format_message().rstrip('.')}; see '{error.ctx.command_path if error.ctx else 'matest'} -h'.", 2)
    except OSError as error:
        _fail(f"{error.filename or 'file system'}: {error.strerror or error}.", 1)
    except KeyboardInterrupt:
        code = _INTERRUPTED
    if code == _INTERRUPTED:
        _fail("interrupted; what was not finished was not written.", 1)
    sys.exit(code)


@app.command(epilog="Example: matest estimate renders/vase --model oren-nayar")
def estimate(
    captures: Annotated[list[Path], typer.Argument(metavar="CAPTURE...", help="Folders with a capture.toml.")],
    out: Out = None,
    model: Annotated[
        str, typer.Option(help="A model or sum, as 'oren-nayar+torrance-sparrow'; see 'matest models'.")
    ] = "auto",
    fix: arguments.Fix = None,
    free: arguments.Free = None,
    tie: arguments.Tie = None,
    holdout: Annotated[str, typer.Option(metavar="INDEX,...", help="Images to leave out of the fit.")] = "",
    precision: Annotated[
        float | None,
        typer.Option(metavar="R", help="Stop once every relative standard error is below R.", show_default=False),
    ] = None,
    transfer: Transfer = None,
    seed: Annotated[int, typer.Option(help="Of the subsample that the search starts from.")] = 0,
    device: Annotated[str, typer.Option(help="Where to compute: cpu, cuda.")] = "cpu",
    as_json: Json = False,
) -> None:
    """Estimate the material of photographed objects, with error bars.

    The result goes to CAPTURE/matest (or OUT; with several captures OUT/<capture name>/ each): result.json,
    material.json, report.html, profile.csv and pictures.
    """
    from matest.capture.description import capture_file
    from matest.estimation.specification import Constraints, specify
    from matest.report.folder import check_destination

    constraints = Constraints(
        dict(map(arguments.assignment, fix or [])), tuple(free or ()), dict(map(arguments.pair, tie or []))
    )
    left_out = arguments.indices(holdout)
    if model != "auto":
        specify(model, constraints, channels=_any_channels(constraints), relative=False)
    _check_device(device)
    root = Path(os.path.commonpath([path.absolute() for path in captures]))
    root = root if root.is_dir() else root.parent
    places = _places(captures, out)
    if len(captures) == 1:
        capture_file(captures[0], "capture.toml")
    for place in places.values():
        check_destination(place, "result.json")

    outcomes: dict[str, Any] = {}
    for path, place in places.items():
        try:
            with progress(f"{path}") as say:
                capture = _load(path, transfer, root, say)
                found = matest.estimate(
                    capture, model, fix=constraints.fix, free=constraints.free, tie=constraints.tie,
                    holdout=left_out, precision=precision, seed=seed, device=device, progress=say,
                )  # fmt: skip
                outcomes[str(path)] = _write(found, capture, place, say)
        except InputError as error:
            if len(places) == 1:
                raise
            outcomes[str(path)] = str(error)
    _report_estimates(outcomes, places, as_json)
    if any(isinstance(outcome, str) for outcome in outcomes.values()):
        raise typer.Exit(2)


@app.command(epilog="Example: matest predict renders/vase/matest renders/vase -o prediction")
def predict(
    result: Annotated[Path, typer.Argument(help="A result folder of 'matest estimate'.")],
    capture: Annotated[Path, typer.Argument(help="The capture whose lights to use.")],
    out: Out = None,
    transfer: Transfer = None,
    as_json: Json = False,
) -> None:
    """Shade an estimated material under a capture's lights.

    Prints the error against each photograph; writes linear radiance (NN.exr), pictures and prediction.json to OUT
    (default: RESULT-predict-<capture name>).
    """
    from matest.estimation.estimate import image_errors
    from matest.estimation.result import load_material, material_is_relative
    from matest.report.folder import check_destination, write_prediction

    material = load_material(result)
    folder = result if result.is_dir() else result.parent
    place = out or folder.with_name(f"{folder.name}-predict-{_name(capture)}")
    check_destination(place, "prediction.json")
    with progress(str(capture)) as say:
        loaded = _load(capture, transfer, None, say)
        say("shading")
        errors = image_errors(loaded, material)
        write_prediction(material, errors, loaded, place)
    if not loaded.relative and material_is_relative(result):
        note(f"the albedo in {result} is known up to a scale only, so brightness and errors here are off by that.")
    if as_json:
        print_json({"out": str(place), "relative_rmse": dict(zip(loaded.names, errors, strict=True))})
        return
    from matest.report.tables import prediction_table

    console().print(prediction_table(errors, loaded.names), f"Written to {place}")


@app.command(epilog="Example: matest render renders/vase/scene.toml -o vase-capture")
def render(
    scene: Annotated[Path, typer.Argument(help="A scene.toml, or its folder.")],
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Render a scene to a capture.

    Writes images, mask, normals and capture.toml to OUT (default: the scene's folder).
    """
    from matest.simulate import simulate

    with progress(str(scene)) as say:
        folder = simulate(scene, out, lambda done, total: say("rendering images", done, total))
    if as_json:
        print_json({"out": str(folder)})
    else:
        typer.echo(f"Written to {folder}")


@app.command(epilog="Example: matest compare truth/00.exr oren-nayar/00.exr lambert/00.exr --row 128 -o figure-13")
def compare(
    images: Annotated[list[Path], typer.Argument(metavar="A B...", help="Images; the first is the reference.")],
    row: Annotated[int | None, typer.Option(help="Along this row (default: the middle one).")] = None,
    column: Annotated[int | None, typer.Option(help="Along this column.")] = None,
    line: Annotated[str | None, typer.Option(metavar="X0,Y0,X1,Y1", help="Along this line, pixel indices.")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Stem of the plot OUT.png and the table OUT.csv.")] = Path(
        "compare"
    ),
    as_json: Json = False,
) -> None:
    """Compare images along a cross-section.

    Prints rms and maximum difference in brightness from the first image; writes a plot and a CSV file.
    """
    from matest import profiles
    from matest.photographs.images import read_image
    from matest.report.pictures import write_columns
    from matest.report.plots import plot_profiles

    if len(images) < 2:
        raise InputError("compare needs two images or more; the first is the reference.")
    pixels = [_as_fractions(read_image(path)) for path in images]
    height, width = pixels[0].shape[:2]
    chosen = profiles.middle_row((height, width))
    if sum(option is not None for option in (row, column, line)) > 1:
        raise InputError("give one of --row, --column and --line.")
    if row is not None:
        chosen = (0.0, float(row), width - 1.0, float(row))
    elif column is not None:
        chosen = (float(column), 0.0, float(column), height - 1.0)
    elif line is not None:
        chosen = arguments.line(line)
    found = profiles.compare(pixels, _distinct(images), chosen)
    out.parent.mkdir(parents=True, exist_ok=True)
    stem = out.with_suffix("") if out.suffix in (".png", ".csv") else out
    plot, table = Path(f"{stem}.png"), Path(f"{stem}.csv")
    plot_profiles(found, plot)
    write_columns(table, {"distance": found.distance, **dict(zip(found.names, found.profiles, strict=True))})
    if as_json:
        figures = zip(found.names, found.rms, found.maximum, found.peak, strict=True)
        rows = [{"image": n, "rms": r, "maximum": m, "peak": p} for n, r, m, p in figures]
        print_json({"plot": str(plot), "csv": str(table), "images": rows})
        return
    from matest.report.tables import comparison_table

    console().print(comparison_table(found), f"Written to {plot} and {table}")


@app.command(epilog="Example: matest models")
def models(as_json: Json = False) -> None:
    """List the reflectance models.

    With their parameters, units, options and sources, and the named materials of the papers.
    """
    from matest.brdf import MODELS, PRESETS
    from matest.parameters import options_of, parameters_of

    if as_json:
        catalogue = {}
        for name, model in MODELS.items():
            parameters = {
                key: {"unit": p.unit, "lower": p.domain.lower, "upper": _finite(p.domain.upper), "doc": p.doc}
                | ({"when": dict(p.when)} if p.when else {})
                for key, p in parameters_of(model).items()
            }
            catalogue[name] = {"source": model.source, "parameters": parameters, "options": options_of(model)}
        print_json(catalogue)
        return
    from matest.report.tables import models_table, presets_table

    console().print(models_table(MODELS), presets_table(PRESETS))


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        typer.echo(f"matest {matest.__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def _load(path: Path, transfer: str | None, root: Path | None, say: Say) -> Capture:
    def count(done: int, total: int) -> None:
        say("reading images", done, total)

    return matest.load_capture(path, transfer=arguments.transfer(transfer), root=root, progress=count)


def _write(found: Estimate, capture: Capture, place: Path, say: Say) -> Estimate:
    from matest.report.folder import write_result

    provenance = {
        "matest": matest.__version__,
        "command": " ".join(["matest", *sys.argv[1:]]),
        "inputs": capture.digests(),
    }
    return write_result(replace(found, provenance=provenance), capture, place, say)


def _report_estimates(outcomes: dict[str, Any], places: dict[Path, Path], as_json: bool) -> None:
    if as_json:
        plain = {k: {"error": v} if isinstance(v, str) else v.to_dict() for k, v in outcomes.items()}
        print_json(next(iter(plain.values())) if len(plain) == 1 else plain)
        return
    from matest.report.tables import estimate_table, summary_table

    terminal = console()
    for place, outcome in zip(places.values(), outcomes.values(), strict=True):
        if isinstance(outcome, str):
            typer.echo(f"matest: {outcome}", err=True)
        else:
            terminal.print(estimate_table(outcome))
            terminal.print(f"Result in {place} (open {place / 'report.html'})", soft_wrap=True)
    if len(outcomes) > 1:
        terminal.print(summary_table(outcomes))


def _places(captures: list[Path], out: Path | None) -> dict[Path, Path]:
    """Where the result of each capture goes."""
    if len(captures) == 1:
        return {captures[0]: out or _folder(captures[0]) / "matest"}
    names = [_name(path) for path in captures]
    if out is not None and len(set(names)) < len(names):
        raise InputError(f"two captures have the same name ({', '.join(sorted(names))}); estimate them one by one.")
    return {
        path: _folder(path) / "matest" if out is None else out / name
        for path, name in zip(captures, names, strict=True)
    }


def _folder(capture: Path) -> Path:
    """The folder of a capture given by folder or by file."""
    return capture if capture.is_dir() else capture.parent


def _name(capture: Path) -> str:
    return os.path.basename(os.path.abspath(_folder(capture)))


def _fail(text: str, code: int) -> None:
    print(f"matest: {text}", file=sys.stderr)
    sys.exit(code)


def _any_channels(constraints: Any) -> int:
    """A number of channels that per-channel values fit, for checking names before anything is read."""
    return max((len(value) for value in constraints.fix.values() if isinstance(value, list)), default=1)


def _check_device(device: str) -> None:
    if device == "cpu":
        return
    import torch

    try:
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0][:120]
        raise InputError(f"--device {device} is not available here ({reason}); use cpu, or cuda where there is a GPU.")


def _as_fractions(image: Any) -> Any:
    """Pixel values as floats: integers as fractions of full scale, floats as stored."""
    import numpy as np

    from matest.photographs.images import full_scale

    return image.astype(np.float64) / full_scale(image.dtype)


def _distinct(paths: list[Path]) -> list[str]:
    """Short names of files that differ from each other."""
    for depth in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    return [str(path) for path in paths]


def _finite(value: float) -> float | None:
    return value if value < float("inf") else None
