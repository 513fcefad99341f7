"""``clearcap simulate``: one run of one mechanism."""

from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.output import Json, print_json, say

if TYPE_CHECKING:
    from engine import Run


def simulate(
    mechanism: Annotated[str, typer.Argument(help="A shipped mechanism or a mechanism file.")],
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Set a joint's clearance or any key; may be repeated."),
    ] = None,
    bench: Annotated[str | None, typer.Option(help="Put the mechanism on one of its test benches first.")] = None,
    preset: Annotated[str | None, typer.Option(help="Set one of the mechanism's named sets of values.")] = None,
    step: Annotated[float | None, typer.Option(help="Time step, instead of the file's.")] = None,
    horizon: Annotated[float | None, typer.Option(help="Longest simulated time, instead of the file's.")] = None,
    full_horizon: Annotated[bool, typer.Option("--full-horizon", help="Go on after rest.")] = False,
    trajectory: Annotated[Path | None, typer.Option(help="Write the motion to an HDF5 file: .h5.")] = None,
    every: Annotated[int | None, typer.Option(min=1, help="Of the motion, keep every so many-th step; 1: all.")] = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="Draw curves over time, on a bench its loop: .png, .svg or .pdf; on a bench by default."),
    ] = None,
    animation: Annotated[Path | None, typer.Option("--animate", help="Draw the motion: .gif, .html or .mp4.")] = None,
    json: Json = False,
) -> None:
    """Simulate a mechanism once and print its responses."""
    values = _values(changes or [])
    from engine import load_mechanism
    from engine import simulate as simulate_once

    loaded = load_mechanism(mechanism)
    values = (loaded.preset(preset) if preset else {}) | values
    loaded = loaded.on_bench(bench) if bench else loaded
    if loaded.plot and not (json or plot or trajectory or animation):
        plot = Path(f"{loaded.name}-{bench}.png" if bench else f"{loaded.name}.png")
    check_outputs(trajectory, every, plot, animation)
    with TemporaryDirectory(prefix="clearcap-") as folder:
        motion = trajectory or (Path(folder) / "motion.h5" if plot or animation else None)
        run = simulate_once(
            loaded,
            values,
            step=step,
            horizon=horizon,
            full_horizon=full_horizon,
            trajectory=motion,
            every=every or 1,
            indeterminacy=True,
        )
        if motion and (plot or animation):
            draw(motion, plot, animation)
    files = {"trajectory": trajectory, "plot": plot, "animation": animation}
    _print(run, {name: str(path) for name, path in files.items() if path}, json)
    if run.status != "ok":
        raise typer.Exit(1)


def _print(run: "Run", files: dict[str, str], json: bool) -> None:
    """Print what the run came to and the files that were written."""
    if json:
        face = {"status": run.status, "message": run.message, "responses": run.responses, "units": run.units}
        print_json({**face, "ranges": run.ranges, "certificate": asdict(run.certificate), "files": files})
        return
    print(f"{run.status}{': ' if run.message else ''}{run.message}")
    width = max(map(len, run.responses), default=0)
    for name, value in run.responses.items():
        least, largest = run.ranges.get(name, (value, value))
        between = f"  (friction leaves {least:.6g} to {largest:.6g})" if largest > least else ""
        unit = "" if run.units[name] == "1" else f" {run.units[name]}"
        print(f"{name:{width}}  {value:.10g}{unit}{between}")
    print("\n".join(f"  {name} = {value}" for name, value in asdict(run.certificate).items()))
    for name, path in files.items():
        print(f"{name}: {path}")


def check_outputs(trajectory: Path | None, every: int | None, plot: Path | None, animation: Path | None) -> None:
    """Refuse files that could not be written, before the work begins."""
    from campaign.cli.output_files import ANIMATIONS, PLOTS, TRAJECTORIES, check_output
    from campaign.errors import SpecError

    asked = (("--trajectory", trajectory, TRAJECTORIES), ("--plot", plot, PLOTS), ("--animate", animation, ANIMATIONS))
    for option, path, endings in asked:
        if path:
            check_output(option, path, endings)
    if every and not (trajectory or plot or animation):
        raise SpecError("--every: there is no motion to thin out; give --trajectory, --plot or --animate, or drop it")
    if animation:
        from campaign.pictures.animation import can_write

        if not can_write(animation.suffix):
            raise SpecError(
                f"--animate {animation}: needs ffmpeg, which is not here; install it, or write .gif or .html"
            )


def draw(motion: Path, plot: Path | None, animation: Path | None) -> None:
    """Draw the pictures of a trajectory."""
    from campaign.cli.output_files import replacing
    from campaign.pictures.animation import animate
    from campaign.pictures.curves import plot as draw_curves
    from campaign.pictures.hysteresis import plot_hysteresis
    from engine import read_trajectory

    recorded = read_trajectory(motion)
    draw_plot = plot_hysteresis if recorded.description.get("plot") else draw_curves
    for path, draw in ((plot, draw_plot), (animation, animate)):
        if path:
            say(f"drawing {path}")
            with replacing(path) as temporary:
                draw(recorded, temporary)


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
