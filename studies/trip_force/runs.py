"""The runs of the study: the C-60 on the bench with its contacts in groups, and the results at the pin."""

import copy
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from engine import load_mechanism, simulate
from engine.mechanism import Mechanism
from engine.mechanism.models import mechanism_from
from studies.trip_force.assumptions import Assumptions

THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.5)  # N: forces at which the pin is considered to touch; the bench uses 0.1
GROUPS = {"latch": ("C4",), "bump": ("C5",), "flanges": ("S1", "S2", "S4", "Sx", "S5", "S12", "S11", "S8", "S7")}
FRICTION = {"latch", "bump", "bar", "pin", "flanges"}
NO_TORQUE = 1e-9  # N mm: keeps the spring in the mechanism, so that its structure is compiled only once


class Push(NamedTuple):
    """Result of a test of the tripping force."""

    status: str
    force: float  # N: largest force before release
    at_peak: dict[float, float]  # mm from touching to the largest force, by the force that defines touching
    release: dict[float, float]  # mm from touching to release


def run(assumed: Assumptions) -> Push:
    """Return the result with a set of assumptions; NaN if the latch did not hold or never released."""
    mechanism = bench(assumed.bench, assumed.held)
    shipped = load_c60()
    presets = shipped.preset("prototype") | (shipped.preset(assumed.preset) if assumed.preset else {})
    # Of the presets only the settling is taken: the steps stay those of the bench.
    values = {key: x for key, x in presets.items() if not key.startswith("simulation.")} | {
        **{f"materials.{name}.friction": getattr(assumed, name) for name in FRICTION},
        "materials.plastic_plastic.friction": assumed.plastics,
        "materials.steel_plastic.friction": assumed.steel,
        "torques.bar_return.torque.z": -max(assumed.torque, NO_TORQUE),
        "springs.bar_return.stiffness": max(assumed.stiffness, NO_TORQUE),
        "springs.A3.preload": assumed.preload,
        **{f"contacts.C5_{i}.a.arc.radius": assumed.bump_radius for i in (1, 2)},
        "parameters.latch_angle": np.radians(assumed.angle),
    }
    found = simulate(mechanism, values)
    measured = found.responses
    touches = {limit: measured.get(_name(limit), np.nan) for limit in THRESHOLDS}
    return Push(
        found.status,
        measured.get("peak_force", np.nan),
        {limit: measured.get("way_at_peak", np.nan) - touch for limit, touch in touches.items()},
        {limit: measured.get("way", np.nan) - touch for limit, touch in touches.items()},
    )


@lru_cache(maxsize=1)
def load_c60() -> Mechanism:
    """Return the C-60; cached, because reading its file takes longer than some runs."""
    return load_mechanism("c60")


@lru_cache(maxsize=4)
def bench(name: str, held: bool) -> Mechanism:
    """Return a bench of the C-60 with a material for each group of contacts, and a spring on the tripping bar."""
    data = load_c60().on_bench(name).model_dump(by_alias=True, exclude_unset=True)
    data["materials"] |= {group: {"friction": 0.3, "restitution": 0.0} for group in FRICTION}
    for contact, table in data["contacts"].items():
        for group, stops in GROUPS.items():
            if contact.split("_")[0] in stops:
                table["material"] = group
    data["joints"]["J4"]["material"] = "bar"
    data["joints"]["hole"]["material"] = "pin"
    bodies = data["bodies"]
    data["springs"]["bar_return"] = {
        "type": "torsion",
        "a": "plate",
        "b": "tripping_bar",
        "axis": [0.0, 0.0, 1.0],
        "stiffness": NO_TORQUE,
        "free_angle": bodies["tripping_bar"]["angle"] - bodies["plate"]["angle"],
    }
    data["torques"]["bar_return"] = {"body": "tripping_bar", "torque": [0.0, 0.0, -NO_TORQUE], "frame": "world"}
    for limit in THRESHOLDS:
        touch = copy.deepcopy(data["responses"]["touch"])
        touch["at"]["above"] = limit
        data["responses"][_name(limit)] = touch
    if held:
        _hold(data)
    return mechanism_from(data, f"{name}, held" if held else name)


def _hold(data: dict[str, Any]) -> None:
    """Guide the pin along Y while it pushes, instead of a guide that allows it to give way laterally."""
    push = data["motions"]["push"]
    data["motions"]["across"] = push | {"along": {"direction": [1.0, 0.0, 0.0]}, "law": {"speed": 0.0}}


def _name(limit: float) -> str:
    return f"touch_at_{limit:g}".replace(".", "_")
