"""200 measured levers from gauge to a looser tolerance: `python -m studies.levers` prints the tables of levers.md.

The levers are virtual, so that what is true is known: they are made by the shipped mechanism `lever`, with a friction
and a spread of the short arm that differ from what its first campaign assumes, and measured by a gauge that errs. What
the public functions find of it stands beside what is true.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import clearcap
from clearcap.questions.confirmation import Confirmation
from reporting.capability.intervals import share_interval
from reporting.comparison import Validation
from reporting.emulation.calibration import Calibration
from reporting.gauge import GaugeStudy
from studies import head, made_by, show

TRUE_FRICTION, ASSUMED_FRICTION = 0.08, 0.02
TRUE_SHORT, ASSUMED_SHORT = 0.03, 0.05  # mm: standard deviations of the short arm
GAUGE = 0.01  # N: repeatability, the same wherever a force is measured
LSL, USL = 9.6, 10.4  # N
FRICTION = "materials.polished.friction"
FORCE = {"unit": "N", "lsl": LSL, "usl": USL}
PARTS_SEED, FRESH_SEED, CAMPAIGN_SEED = 4711, 4712, 4713
GAUGED, TRIALS, BENCHED, PULLS = 10, 3, 8, 5
HEAD = head("step", "what", "true", "found", "95 % interval")


@dataclass(frozen=True)
class Sizes:
    """How many runs each campaign has; the parts are always 200."""

    rows: int = 1_000  # of a campaign that predicts
    emulated: int = 64  # of the campaign whose rows calibrate
    fresh: int = 100_000  # levers that confirm
    parts: int = 200


def campaign(
    name: str, friction: Mapping[str, Any], short: float, samples: int, seed: int, **more: Any
) -> dict[str, Any]:
    """Return the tables of a campaign of the lever."""
    return {
        "format": 1,
        "name": name,
        "mechanism": "lever",
        "samples": samples,
        "seed": seed,
        "repeats": {"share": 0.0},
        "variables": {
            "long": _normal("parameters.long", 30.0, 0.06),
            "short": _normal("parameters.short", 12.0, short),
            "load": _normal("parameters.load", 4.0, 0.012),
            "pin": {"distribution": "uniform", "lower": 0.03, "upper": 0.07},
            "friction": {"target": FRICTION, **friction},
        },
        "responses": {"force": {"lsl": LSL, "usl": USL}},
        **more,
    }


def _normal(target: str, mean: float, std: float) -> dict[str, Any]:
    return {"target": target, "distribution": "normal", "mean": mean, "std": std}


def fixed(friction: float) -> dict[str, Any]:
    """Return the distribution of a friction that is one number."""
    return {"distribution": "constant", "value": friction}


@dataclass(frozen=True)
class Story:
    """What each step found."""

    gauge: GaugeStudy
    measured: Mapping[str, Any]  # the capability in capability.json
    short: tuple[float, float]  # mm: measured mean and standard deviation of the short arm
    before: Validation
    calibration: Calibration
    after: Validation
    confirmation: Confirmation
    loosened: float  # mm: standard deviation of the short arm
    fresh: tuple[int, int]  # fresh levers out of limits, and all
    fresh_spread: tuple[float, float]  # N: mean and standard deviation of their forces


def tell(folder: Path, sizes: Sizes) -> Story:
    """Return the story, whose tables and campaigns are written into a folder."""
    store, rng = folder / "runs", np.random.default_rng(PARTS_SEED)

    def run(tables: dict[str, Any]) -> clearcap.Results:
        return clearcap.run_campaign(tables, store=store, progress=False, decide=False)

    made = run(campaign("true", fixed(TRUE_FRICTION), TRUE_SHORT, sizes.parts, PARTS_SEED)).ok
    table = made[["short", "force"]] + rng.normal(0.0, [0.002, GAUGE], (len(made), 2))
    table.to_csv(folder / "parts.csv", index=False)

    repeated = made["force"].to_numpy()[:GAUGED].repeat(TRIALS)
    trials = pd.DataFrame({"part": np.arange(GAUGED).repeat(TRIALS), "value": rng.normal(repeated, GAUGE)})
    gauge = clearcap.gauge_study(trials, tolerance=USL - LSL).repeatability
    assert gauge is not None
    found = gauge.of("gauge R&R").std
    limits = {"characteristics": {"force": FORCE | {"gauge_sigma": found, "gauge_freedom": gauge.freedom}}}
    files = clearcap.capability_report(folder / "parts.csv", limits, folder / "capability", ["json"])
    measured = json.loads(Path(files["json"]).read_text("utf-8"))["responses"][0]["capability"]

    assumed = run(campaign("assumed", fixed(ASSUMED_FRICTION), ASSUMED_SHORT, sizes.rows, CAMPAIGN_SEED))
    before = clearcap.validate_campaign(table[["force"]], assumed.id, store)

    prior = {"distribution": "uniform", "lower": 0.0, "upper": 0.13}
    bench = run(campaign("bench", prior, ASSUMED_SHORT, sizes.emulated, CAMPAIGN_SEED, sampler="sobol"))
    pulls = rng.normal(made["force"].to_numpy()[:BENCHED], GAUGE / PULLS**0.5)
    values = [
        {
            "response": "force",
            "value": float(value),
            "sigma": GAUGE / PULLS**0.5,
            "specimen": str(i),
            "at": {name: float(made[name].iloc[i]) for name in ("long", "short", "load")},
        }
        for i, value in enumerate(pulls)
    ]
    calibration = clearcap.calibrate_campaign({"constants": ["friction"], "measurements": values}, bench.id, store)

    short = float(table["short"].mean()), float(table["short"].std())
    draws = rng.permutation(calibration.draws["friction"])[:400]  # they are sorted
    drawn = {"distribution": "empirical", "values": draws.tolist()}
    calibrated = run(campaign("calibrated", drawn, short[1], sizes.rows, CAMPAIGN_SEED))
    after = clearcap.validate_campaign(table[["force"]], calibrated.id, store)

    confirmation = calibrated.confirm({"variables": {"short": {"cost": 0.05}}}, progress=False)
    loosened = confirmation.proposal.tolerances["short"]
    fresh = run(campaign("fresh", fixed(TRUE_FRICTION), loosened, sizes.fresh, FRESH_SEED)).ok["force"]
    beyond = int(((fresh < LSL) | (fresh > USL)).sum())
    return Story(
        *(gauge, measured, short, before, calibration, after, confirmation, loosened),
        (beyond, len(fresh)),
        (float(fresh.mean()), float(fresh.std())),
    )


def lines(story: Story) -> Iterator[str]:
    """Yield the table of what is true and what was found, then what was said and decided."""
    repeatability, constant = story.gauge.of("gauge R&R"), story.calibration.constants[0]
    yield HEAD
    yield _row("gauge", "sigma, N", f"{GAUGE:.4f}", f"{repeatability.std:.4f}", repeatability.std_interval)
    yield _row("capability", "Cpk, as measured", "", f"{story.measured['cpk']:.2f}", story.measured["cpk_interval"])
    for name, found in (("before", story.before), ("after", story.after)):
        of = found.predictions[0].comparison
        yield _row(
            f"validation {name}", "measured less simulated mean, N", "", f"{of.mean_difference:+.4f}", of.mean_interval
        )
        yield _row(f"validation {name}", "ratio of the sigmas", "", f"{of.std_ratio:.3f}", of.std_ratio_interval)
    yield _row("calibration", "friction", f"{TRUE_FRICTION:.4f}", f"{constant.mean:.4f}", constant.interval)
    yield _row("short arm", "mean, mm", "12.0000", f"{story.short[0]:.4f}", None)
    yield _row("short arm", "sigma, mm", f"{TRUE_SHORT:.4f}", f"{story.short[1]:.4f}", None)
    judged = story.confirmation.rounds[-1].responses[0]
    yield _row("looser", "sigma of the short arm, mm", "", f"{story.loosened:.4f}", None)
    yield _row("looser", "Cpk, promised", "", f"{judged.promised:.3f}", judged.promised_interval)
    yield _row("looser", "Cpk, fresh runs", "", f"{judged.cpk:.3f}", judged.cpk_interval)
    beyond, count = story.fresh
    low, high = (1e6 * x for x in share_interval(beyond, count, 0.95))
    yield f"| true levers | rejects, ppm | | {beyond} of {count:,} | {low:.0f} to {high:.0f} |"
    yield ""
    for name, found in (("before", story.before), ("after", story.after)):
        yield f"- {name}: {found.predictions[0].verdict}"
    yield f"- {story.confirmation.text}, {len(story.confirmation.rounds)} rounds"
    yield f"- true levers: mean {story.fresh_spread[0]:.4f} N, sigma {story.fresh_spread[1]:.4f} N"


def _row(step: str, what: str, true: str, found: str, interval: tuple[float, float] | list[float] | None) -> str:
    ends = "" if interval is None else f"{interval[0]:.4f} to {interval[1]:.4f}"
    return f"| {step} | {what} | {true} | {found} | {ends} |"


def main() -> None:
    """Tell the story in a folder of its own, and print its tables."""
    parser = argparse.ArgumentParser(prog="python -m studies.levers", description=__doc__)
    parser.add_argument("--fresh", type=int, default=Sizes.fresh, help="levers that confirm; default: %(default)s")
    asked, began = parser.parse_args(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        show(lines(tell(Path(folder), Sizes(fresh=asked.fresh))))
    show([made_by(began)])


if __name__ == "__main__":
    main()
