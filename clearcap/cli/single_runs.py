"""Verbs that simulate apart from a campaign: ``simulate``, ``replay``, ``polarisation`` and ``bench``."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from math import isnan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.errors import CampaignError, SpecError
from clearcap.cli.options import CampaignId, StoreUrl, named_mechanism, opened_campaign
from clearcap.cli.output import Json, print_json, print_table, print_text, say
from clearcap.output_files import ANIMATIONS, PLOTS, check_output, replacing

if TYPE_CHECKING:
    from campaign.plan import Plan
    from engine import Run
    from engine.profile.step_times import StepTimes

TRAJECTORIES = (".h5", ".hdf5")


@dataclass(frozen=True)
class RunFiles:
    """The files that a user requests for one run."""

    trajectory: Path | None  # HDF5 file with the motion
    plot: Path | None  # curves over time, or hysteresis on a test bench
    animation: Path | None

    def named(self) -> dict[str, str]:
        """Return the path of each file by its kind."""
        return {kind: str(path) for kind, path in vars(self).items() if path}

    def check(self) -> None:
        """Check, before the work begins, that the files can be written; raises the errors of `check_output`."""
        for option, path, endings in (
            ("--trajectory", self.trajectory, TRAJECTORIES),
            ("--plot", self.plot, PLOTS),
            ("--animate", self.animation, ANIMATIONS),
        ):
            if path:
                check_output(option, path, endings)

    @contextmanager
    def recording(self) -> Iterator[Path | None]:
        """Yield the path for the run's trajectory, or None; draw the pictures at the end of the block."""
        with TemporaryDirectory(prefix="clearcap-") as folder:
            trajectory = self.trajectory or (Path(folder) / "motion.h5" if self.plot or self.animation else None)
            yield trajectory
            if trajectory and (self.plot or self.animation):
                from clearcap.drawing import draw_run
                from engine import read_trajectory

                recorded = read_trajectory(trajectory)
                for path in filter(None, (self.plot, self.animation)):
                    say(f"drawing {path}")
                    with replacing(path) as temporary:
                        draw_run(recorded, temporary)


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
    from campaign.compiling import compile_engine
    from clearcap.questions.mechanisms import values_of
    from engine import Recording, set_values
    from engine import simulate as simulate_once
    from engine.preflight import cautions

    values = values_of(changes or [])
    loaded = named_mechanism(mechanism)
    values = (loaded.preset(preset) if preset else {}) | values
    loaded = loaded.on_bench(bench) if bench else loaded
    if loaded.plot and not (json or plot or trajectory or animation):
        plot = Path(f"{loaded.name}-{bench}.png" if bench else f"{loaded.name}.png")
    files = RunFiles(trajectory, plot, animation)
    files.check()
    if every and not files.named():
        raise SpecError(
            "--every: no motion is recorded; give --trajectory, --plot or --animate too, or leave --every out"
        )
    changed = set_values(loaded, values)  # a misspelt key is told at once, and not after the engine is compiled
    compile_engine()
    with files.recording() as motion:
        recording = Recording(motion, every or 1) if motion else None
        times: Any = {"step": step, "horizon": horizon, "full_horizon": full_horizon}
        run = simulate_once(loaded, values, **times, trajectory=recording, indeterminacy=True)
    if step is not None and run.status in ("not_at_rest", "diverged"):
        from engine.preflight.cautions import step_caution

        if (slower := step_caution(changed, step, horizon)) is not None:  # has the longest step
            run = replace(run, message=f"{run.message}; but the step is too long: {slower.remedy}")
    _print_run(run, files.named(), json)
    for doubt in run.certificate.doubts():
        say(f"warning: {doubt}")
    if run.status != "ok":
        for caution in cautions(changed):
            say(f"warning: {caution}")
        raise typer.Exit(1)


def _print_run(run: "Run", files: dict[str, str], json: bool) -> None:
    if json:
        from clearcap.questions.mechanisms import run_document

        print_json({**run_document(run), "files": files})
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
    for remark in run.remarks:
        print_text(f"note: {remark}")
    print_text("\n".join(f"  {name} = {value}" for name, value in asdict(run.certificate).items()), lines=True)
    for name, path in files.items():
        print_text(f"{name}: {path}")


def replay(
    campaign: CampaignId,
    sample: Annotated[int, typer.Argument(min=0, help="Number of the sample.")],
    store: StoreUrl = "runs",
    trajectory: Annotated[Path | None, typer.Option(help="Write the motion to an HDF5 file: .h5.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw curves over time: .png, .svg or .pdf.")] = None,
    animation: Annotated[Path | None, typer.Option("--animate", help="Draw the motion: .gif, .html or .mp4.")] = None,
    halved: Annotated[
        bool, typer.Option("--repeat", help="Replay the sample's repeat, which has half the step.")
    ] = False,
    json: Json = False,
) -> None:
    """Repeat one run of a campaign in this process, and compare it with its stored row, bit for bit."""
    from campaign.row_build import differences
    from clearcap.questions.samples import check_sample, replay_sample

    opened, plan = opened_campaign(store, campaign, is_patient=True)
    check_sample(plan, sample)
    files = RunFiles(trajectory, plot, animation)
    files.check()
    if different := differences(plan.row_build):
        say(f"the campaign was computed with another build of clearcap, so numbers may differ: {different}")
    with files.recording() as motion:
        replayed = replay_sample(opened, plan.campaign_id, sample, motion, halved=halved)
    if json:
        print_json(replayed.model_dump())
    else:
        _print_replayed(plan, replayed.row, replayed.same, "repeat" if halved else "row")
    if replayed.is_broken:
        raise typer.Exit(1)


def _print_replayed(plan: "Plan", row: dict[str, Any], same: bool | None, what: str) -> None:
    """Print the row or the repeat, and whether it equals the stored one."""
    print_text(f"sample {row['sample']}: {row['status']}{': ' if row['message'] else ''}{row['message']}")
    units = plan.mechanism.response_units()
    for name in plan.spec.variables:
        print_text(f"  {name} = {row[name]:.10g}")
    for name in plan.mechanism.responses:
        unit = "" if units[name] == "1" else f" {units[name]}"
        value = "-" if row[name] is None else f"{row[name]:.10g}{unit}"
        print_text(f"{name}  {value}")
    words = {
        None: f"the store has no {what} of this sample yet",
        True: f"equal to the {what} in the store, bit for bit",
        False: f"differs from the {what} in the store",
    }
    print_text(words[same])


def polarisation(
    campaign: Annotated[str, typer.Argument(help="A shipped campaign or a campaign file.")],
    picture: Annotated[Path, typer.Argument(help="Picture file to write: .png, .svg or .pdf.")],
    samples: Annotated[int, typer.Option(min=1, help="Number of samples to simulate, counted from the first.")] = 100,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of worker processes; by default one per core.")
    ] = None,
    json: Json = False,
) -> None:
    """Draw where each journal lies in its bearing at the end of the runs, and the direction in which it presses."""
    from campaign.processes import cores
    from campaign.spec.load import load_campaign
    from clearcap.pictures.play import plot_polarisation
    from clearcap.questions.mechanisms import campaign_journal_positions

    check_output("polarisation", picture, PLOTS)
    loaded = load_campaign(campaign, samples=samples)
    say(f"simulating {samples} samples")
    journals = campaign_journal_positions(loaded, workers or cores())
    if not journals:
        raise CampaignError(
            f"polarisation: no journal to draw: either {loaded.mechanism.name} has no round joint with clearance, or "
            f"all {samples} runs failed; look at one run with clearcap simulate"
        )
    with replacing(picture) as temporary:
        plot_polarisation(journals, f"{loaded.spec.title or loaded.spec.name}, where journals lie", temporary)
    failed = samples - len(journals[0].eccentricities)
    if json:
        print_json({"picture": str(picture), "samples": samples, "failed": failed})
    else:
        print_text(f"picture: {picture}" + (f" ({failed} of {samples} runs failed and are left out)" if failed else ""))


def bench(
    mechanisms: Annotated[
        list[str] | None, typer.Argument(metavar="[MECHANISM]...", help="Shipped mechanisms or mechanism files.")
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Number of time steps; by default those of the horizon, at most 7000.")
    ] = None,
    json: Json = False,
) -> None:
    """Measure the time of a step, its share per stage, and the residuals that the solver leaves.

    Without arguments it measures all shipped mechanisms.
    """
    from engine import library_names
    from engine.profile.step_times import measure_step_times

    loaded = [named_mechanism(name) for name in mechanisms or library_names()]
    say("compiling the time loop that measures its stages: about a minute, before the first mechanism")
    measured = []
    for mechanism in loaded:
        measured.append(measure_step_times(mechanism, steps))
        say(f"{mechanism.name}: {measured[-1].step_us:.3g} us per step")
    if json:
        print_json([asdict(entry) for entry in measured])
    else:
        _print_step_times(measured)
    if any(entry.status != "ok" for entry in measured):
        raise typer.Exit(1)


def _print_step_times(measured: "list[StepTimes]") -> None:
    for title, columns in TABLES.items():
        rows = [[entry.mechanism, *(_cell(getattr(entry, c)) for c in columns)] for entry in measured]
        print_table(title, ("mechanism", *columns.values()), rows, texts=1)
    shares = [[entry.mechanism, *(f"{100 * part:.1f}" for part in entry.shares.values())] for entry in measured]
    print_table("share of the time [%]", ("mechanism", *measured[0].shares), shares, texts=1)
    for entry in measured:
        if entry.message:
            print_text(f"{entry.mechanism}: {entry.message}")


TABLES = {
    "size and speed": {
        "bodies": "bodies",
        "contacts": "contacts",
        "ties": "joint rows",
        "steps": "steps",
        "repeated": "repeated",
        "step_us": "us/step",
        "iterations_per_step": "iter/step",
    },
    "largest residuals of the steps": {
        "status": "status",
        "max_residual": "residual",
        "max_penetration": "penetration",
        "max_violation": "joint violation",
    },
}


def _cell(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
