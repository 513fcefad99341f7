"""``clearcap simulate``: one run of one mechanism."""

from dataclasses import asdict, replace
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.named_mechanism import named_mechanism
from campaign.cli.output import Json, print_json, print_text, say
from campaign.cli.run_files import RunFiles

if TYPE_CHECKING:
    from engine import Mechanism, Run


def simulate(
    mechanism: Annotated[str, typer.Argument(help="A shipped mechanism or a mechanism file.")],
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Set the clearance of a joint, or any other key of the mechanism; may be repeated.",
        ),
    ] = None,
    bench: Annotated[str | None, typer.Option(help="Simulate the mechanism on one of its test benches.")] = None,
    preset: Annotated[str | None, typer.Option(help="Use one of the mechanism's named sets of values.")] = None,
    step: Annotated[float | None, typer.Option(help="Time step, in place of the file's.")] = None,
    horizon: Annotated[float | None, typer.Option(help="Longest simulated time, in place of the file's.")] = None,
    full_horizon: Annotated[
        bool,
        typer.Option("--full-horizon", help="Simulate the whole horizon, also after the mechanism has come to rest."),
    ] = False,
    trajectory: Annotated[Path | None, typer.Option(help="Write the motion to an HDF5 file: .h5.")] = None,
    every: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Record only every N-th step of the motion; 1 records all.")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            help="Draw the curves over time, or the hysteresis loop on a test bench: .png, .svg or .pdf."
            " By default only the loop of a test bench is drawn."
        ),
    ] = None,
    animation: Annotated[Path | None, typer.Option("--animate", help="Draw the motion: .gif, .html or .mp4.")] = None,
    json: Json = False,
) -> None:
    """Simulate a mechanism once and print its responses."""
    values = _values(changes or [])
    from campaign.compiling import compile_engine
    from engine import Recording, set_values
    from engine import simulate as simulate_once
    from engine.preflight import cautions

    loaded = named_mechanism(mechanism)
    values = (loaded.preset(preset) if preset else {}) | values
    loaded = loaded.on_bench(bench) if bench else loaded
    if loaded.plot and not (json or plot or trajectory or animation):
        plot = Path(f"{loaded.name}-{bench}.png" if bench else f"{loaded.name}.png")
    files = RunFiles(trajectory, plot, animation)
    files.check()
    _check_every(every, files)
    compile_engine()
    with files.recording() as motion:
        run = simulate_once(
            loaded,
            values,
            step=step,
            horizon=horizon,
            full_horizon=full_horizon,
            trajectory=Recording(motion, every or 1) if motion else None,
            indeterminacy=True,
        )
    if step is not None and run.status == "not_at_rest":
        run = _with_longest_step(run, set_values(loaded, values), step, horizon)
    _print(run, files.named(), json)
    if run.status != "ok":
        for caution in cautions(set_values(loaded, values)):
            say(f"warning: {caution}")
        raise typer.Exit(1)


def _with_longest_step(run: "Run", mechanism: "Mechanism", step: float, horizon: float | None) -> "Run":
    """Return the run; if its step is to blame, its message also names the longest step that comes to rest."""
    from engine.preflight.cautions import step_caution

    caution = step_caution(mechanism, step, horizon)
    if caution is None:
        return run
    return replace(run, message=f"{run.message}; but the step is too long: {caution.remedy}")


def _check_every(every: int | None, files: RunFiles) -> None:
    """Raise SpecError if ``--every`` is given but no motion is recorded."""
    from campaign.errors import SpecError

    if every and not files.named():
        raise SpecError(
            "--every: no motion is recorded; give --trajectory, --plot or --animate too, or leave --every out"
        )


def _print(run: "Run", files: dict[str, str], json: bool) -> None:
    """Print the results of the run and the written files."""
    if json:
        results = {"status": run.status, "message": run.message, "responses": run.measured, "units": run.units}
        print_json({**results, "ranges": run.ranges, "certificate": asdict(run.certificate), "files": files})
        return
    print_text(f"{run.status}{': ' if run.message else ''}{run.message}")
    if run.status != "ok" and run.measured:
        print_text("measured when the run ended:")
    width = max(map(len, run.measured), default=0)
    for name, value in run.measured.items():
        least, largest = run.ranges.get(name, (value, value))
        interval = f"  (friction allows {least:.6g} to {largest:.6g})" if largest > least else ""
        unit = "" if run.units[name] == "1" else f" {run.units[name]}"
        shown = "not measured" if isnan(value) else f"{value:.10g}{unit}{interval}"
        print_text(f"{name:{width}}  {shown}")
    print_text("\n".join(f"  {name} = {value}" for name, value in asdict(run.certificate).items()), lines=True)
    for name, path in files.items():
        print_text(f"{name}: {path}")


def _values(changes: list[str]) -> dict[str, float]:
    """Return the values of ``KEY=VALUE`` options."""
    from campaign.errors import SpecError

    values: dict[str, float] = {}
    for change in changes:
        key, equals, text = change.partition("=")
        try:
            number = float(text)
        except ValueError:
            equals = ""
        if not equals or not key:
            raise SpecError(f"--set {change}: not KEY=VALUE with a number; write for example --set J1=0.05")
        if key in values:
            raise SpecError(f"--set {change}: {key} is set twice; keep one of them")
        values[key] = number
    return values
