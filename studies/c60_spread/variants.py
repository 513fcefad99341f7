"""The variants of the study: each changes assumptions of the model."""

import tomllib
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

AXIAL = ("S1", "S2", "S4", "Sx", "S5", "S12", "S6", "S11", "S8", "S7")
SHIPPED = "preset paper"
UNIFORM = {"distribution": "uniform", "lower": 0.01, "upper": 0.13}
ENDS = {"distribution": "empirical", "values": [0.01, 0.13]}
SPEEDS = (0.5, 0.05)


@dataclass(frozen=True)
class Variant:
    """Differences from the shipped campaign whose clearances close in free fall, as in the paper."""

    name: str  # row of the table
    tables: dict[str, Any] = field(default_factory=dict)  # override those of the mechanism file, as in a test bench
    values: dict[str, float] = field(default_factory=dict)  # changed numbers of the mechanism by key
    # inputs that vary besides the clearances: key and standard deviation, relative to the value
    varied: dict[str, float] = field(default_factory=dict)
    # Standard deviations of each body's initial velocity [mm/ms] and angular velocity [rad/ms], per component.
    speeds: tuple[float, float] = (0.0, 0.0)
    # distribution of every clearance, as in a campaign file; that of the campaign if empty
    clearances: dict[str, Any] = field(default_factory=dict)
    correlation: float = 0.0  # rank correlation of every two clearances; with 1 the joints share the clearance of J1
    bench: str | None = None  # test bench of the mechanism
    response: str = "FC-1"  # used as FC-1
    step: float | None = None  # fixed [ms]
    fewer: int = 1  # for expensive variants: only every `fewer`-th sample is simulated
    heading: str = ""  # column in the tables of all responses; omitted if empty


def variants() -> list[Variant]:
    """Return the compared variants, the shipped model with preset paper first."""
    return [Variant(SHIPPED), *_of_the_model(), *_of_the_clearances()]


def _of_the_model() -> list[Variant]:
    """Return the variants with the campaign's own clearances."""
    c60, public = _tables("c60"), _tables("c60_public")
    axial = [f"contacts.{name}" for name in c60["contacts"] if name.split("_")[0] in AXIAL]
    as_coded = {
        name: spring | {"actions": public["springs"][name]["actions"]} for name, spring in c60["springs"].items()
    }
    short = [{"name": "hold", "duration": 1.0}, {"name": "free"}]
    damped = {"phases.0.damping": 1.0, "phases.1.damping": 1.0}
    return [
        Variant("fixed steps of 1e-3 ms", step=1e-3),
        Variant("fixed steps of 5e-3 ms", step=5e-3),
        Variant("settling damped, 1/ms", values=damped),
        Variant("latch held for 1 ms only, as in the public file", {"phases": short}),
        Variant("on the way OFF -> ON by the handle (bench cycle)", bench="cycle", fewer=4),
        Variant("random velocities at the start", speeds=SPEEDS),
        Variant("no axial stops: parts move freely along z", {"without": axial}),
        Variant("friction 0.05 everywhere", values=_friction(0.05)),
        Variant("friction 0.1 everywhere", values=_friction(0.1)),
        Variant("friction 0.2 everywhere", values=_friction(0.2)),
        Variant("friction 0.3 everywhere", values=_friction(0.3)),
        Variant("friction 0.3 everywhere, random velocities", values=_friction(0.3), speeds=SPEEDS),
        Variant("preload of A3 0.49 rad (public)", values={"springs.A3.preload": 0.49}),
        Variant("preload of A3 0.6547 rad", values={"springs.A3.preload": 0.6547}),
        Variant("preload of A3 1.0418 rad", values={"springs.A3.preload": 1.0418}),
        Variant("handle spring 2.68 times (as coded)", values={"springs.handle_spring.stiffness": 2.68 * 3.82}),
        Variant("A3 by unbalanced forces (as coded)", {"springs": {"A3": as_coded["A3"]}}),
        Variant("all springs by unbalanced forces (as coded)", {"springs": as_coded}),
        Variant("all springs as coded, friction 0.3 everywhere", {"springs": as_coded}, _friction(0.3)),
        Variant("bump of the latch of radius 0.45", values=_bump(0.45)),
        Variant("bump of the latch of radius 0.499", values=_bump(0.499)),
        Variant("needle seats with 0.1 mm of play", values={"S3": 0.1}),
        Variant("A3 varies, stiffness +- 1 %", varied={"springs.A3.stiffness": 0.01}),
        Variant("A3 varies, stiffness +- 4 %", varied={"springs.A3.stiffness": 0.04}),
        Variant("friction varies, +- 20 %", varied={f"materials.{name}.friction": 0.2 for name in c60["materials"]}),
        Variant("the least that friction allows", response="FC-1_low"),
        Variant("the largest that friction allows", response="FC-1_high"),
        Variant("on the test bench: force on the probe", bench="contact_force", response="force", fewer=4),
        Variant("on the test bench, 1 mm before that: forward", bench="contact_force", response="force_forward"),
        Variant("on the test bench, 1 mm before that: back", bench="contact_force", response="force_back"),
    ]


def _of_the_clearances() -> list[Variant]:
    """Return the variants with dependent clearances or another distribution."""
    rough = _friction(0.3)
    return [
        *(Variant(f"rank correlation {r} of all clearances", correlation=r, heading=f"{r}") for r in (0.3, 0.6, 0.9)),
        Variant("one shared clearance for all joints", correlation=1.0, heading="shared"),
        Variant("shared clearance, friction 0.3, random velocities", correlation=1.0, values=rough, speeds=SPEEDS),
        Variant("clearances uniform on [0.01, 0.13]", clearances=UNIFORM, heading="uniform"),
        Variant("clearances 0.01 or 0.13", clearances=ENDS, heading="0.01 or 0.13"),
        Variant(
            "one shared uniform clearance for all joints",
            correlation=1.0,
            clearances=UNIFORM,
            heading="uniform, shared",
        ),
        Variant(
            "shared uniform clearance, friction 0.3, random velocities",
            correlation=1.0,
            clearances=UNIFORM,
            values=rough,
            speeds=SPEEDS,
        ),
    ]


def _tables(name: str) -> dict[str, Any]:
    """Return a shipped mechanism as plain data."""
    return tomllib.loads(files("engine.mechanism").joinpath("library", f"{name}.toml").read_text("utf-8"))


def _friction(mu: float) -> dict[str, float]:
    """Set the same friction for all pairs of materials."""
    return {f"materials.{pair}.friction": mu for pair in ("steel_plastic", "plastic_plastic", "metal_metal")}


def _bump(radius: float) -> dict[str, float]:
    """Set the radius of the bump at both heights."""
    return {f"contacts.C5_{i}.a.arc.radius": radius for i in (1, 2)}
