"""Jobs for one mechanism: check its text, list its numbers, simulate it once, draw it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from campaign.errors import SpecError
from clearcap.questions.mechanism_summary import mechanism_summary, mechanism_warnings
from engine import (
    Recording,
    load_mechanism,
    load_mechanism_text,
    missing_kernels,
    read_trajectory,
    set_values,
    simulate,
)
from engine.mechanism import Mechanism, library_names
from engine.mechanism.keys.values import settable_numbers
from engine.platform.toml_file import UnfitToml, parse_toml, text_bytes

PICTURES = ("svg", "png")
ANIMATION_FRAMES = 45  # half the frames of the command line, so that the animation is ready within seconds
MOST_STEPS = 2000  # steps that are recorded of a run that a page draws


@dataclass(frozen=True)
class MechanismSource:
    """The mechanism of a job."""

    name: str  # of a shipped mechanism, or for the text in messages
    text: str | None = None  # content of its file; None for a shipped one
    bench: str | None = None  # one of its test benches
    preset: str | None = None  # one of its sets of values
    values: Mapping[str, float] = field(default_factory=dict)  # by key; they override those of the preset

    def load(self) -> Mechanism:
        """Return the mechanism on its bench, without applying preset and values.

        Raises MechanismError if it has faults, or no such bench. Raises SpecError if no mechanism of this name is
        shipped.
        """
        if self.text is None and self.name not in library_names():
            raise SpecError(f"mechanism {self.name!r:.100}: none of this name; shipped: {', '.join(library_names())}")
        loaded = load_mechanism(self.name) if self.text is None else load_mechanism_text(self.text, self.name)
        return loaded.on_bench(self.bench) if self.bench else loaded

    def all_values(self, mechanism: Mechanism) -> dict[str, float]:
        """Return the values of the preset, overridden by `values`."""
        return (dict(mechanism.preset(self.preset)) if self.preset else {}) | dict(self.values)


def describe(source: MechanismSource) -> dict[str, Any]:
    """Return the summary of a mechanism and every number that can be set, with value, unit and limits."""
    mechanism = source.load()
    values = source.all_values(mechanism)
    mechanism = set_values(mechanism, values) if values else mechanism
    return {**mechanism_summary(mechanism), "keys": [asdict(entry) for entry in settable_numbers(mechanism, "")]}


def titles(sources: Sequence[MechanismSource]) -> dict[str, str]:
    """Return the title of each mechanism by name, from its text alone; empty if the text has none or is not TOML."""
    found = {}
    for source in sources:
        try:
            title = parse_toml(text_bytes(source.text or "")).get("title", "")
        except UnfitToml:
            title = ""
        found[source.name] = title if isinstance(title, str) else ""
    return found


def check_text(source: MechanismSource) -> dict[str, Any]:
    """Return the summary and the warnings of a mechanism's text; raise MechanismError if it has faults."""
    mechanism = source.load()
    return {"summary": mechanism_summary(mechanism), "warnings": mechanism_warnings(mechanism)}


def simulate_once(source: MechanismSource, step: float | None = None, horizon: float | None = None) -> dict[str, Any]:
    """Simulate a mechanism; return the document that ``clearcap simulate --json`` prints, without its files."""
    mechanism = source.load()
    values = source.all_values(mechanism)
    run = simulate(mechanism, values, step=step, horizon=horizon, indeterminacy=True)
    results = {"status": run.status, "message": run.message, "responses": run.measured, "units": run.units}
    return {**results, "ranges": run.ranges, "certificate": asdict(run.certificate)}


def try_once(source: MechanismSource) -> dict[str, Any]:
    """Simulate a mechanism; return the result of `simulate_once` as ``run`` and its `MovingDrawing` as ``motion``."""
    from clearcap.pictures.moving_drawing import moving_drawing
    from clearcap.pictures.scene import scene_of

    results = simulate_once(source)
    every = max(1, results["certificate"]["steps"] // MOST_STEPS)
    mechanism = source.load()
    with TemporaryDirectory(prefix="clearcap-") as folder:
        motion = Path(folder, "motion.h5")
        simulate(mechanism, source.all_values(mechanism), trajectory=Recording(motion, every))
        trajectory = read_trajectory(motion)
    return {"run": results, "motion": asdict(moving_drawing(scene_of(trajectory, ANIMATION_FRAMES), trajectory))}


def warm_up_try_out() -> None:
    """Compile or load all code that a try-out run of a mechanism calls, which includes that of every run."""
    try_once(MechanismSource("c60"))


def engine_is_compiled() -> bool:
    """Return whether `warm_up_try_out` will only load compiled code."""
    return not missing_kernels()


def animate_once(source: MechanismSource, step: float | None = None, horizon: float | None = None) -> bytes:
    """Simulate a mechanism and return its motion as a GIF."""
    from clearcap.pictures.animation import animate

    mechanism = source.load()
    with TemporaryDirectory(prefix="clearcap-") as folder:
        motion, picture = Path(folder, "motion.h5"), Path(folder, "motion.gif")
        simulate(mechanism, source.all_values(mechanism), step=step, horizon=horizon, trajectory=motion)
        animate(read_trajectory(motion), picture, ANIMATION_FRAMES)
        return picture.read_bytes()


def draw(source: MechanismSource, kind: str = "svg") -> bytes:
    """Return a picture, ``svg`` or ``png``, of a mechanism at its start, with what its responses measure."""
    from clearcap.pictures.sketches.sketch_figure import plot_measurements

    if kind not in PICTURES:
        raise SpecError(f"picture {kind!r:.20}: allowed: {', '.join(PICTURES)}")
    mechanism = source.load()
    with TemporaryDirectory(prefix="clearcap-") as folder:
        picture = Path(folder, f"picture.{kind}")
        plot_measurements(set_values(mechanism, source.all_values(mechanism)), picture)
        return picture.read_bytes()
