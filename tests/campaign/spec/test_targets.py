"""What the variables of a campaign may aim at: components, parameters; no key twice, none that follows from another."""

import re
from pathlib import Path

import pytest

from campaign.errors import SpecError
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.worker.row import compute_row, sample_inputs
from engine import simulate
from engine.loop import Cancel
from tests.each import each

PAGE = (Path(__file__).parents[3] / "docs" / "campaign.md").read_text()
EXAMPLE = next(code for code in re.findall(r"```toml runnable\n(.*?)```", PAGE, re.S) if '"lever"' in code)


def campaign(**variables):
    """Return a campaign on the lever with uniform variables: target and ends of each."""
    tables = {
        name: {"target": target, "distribution": "uniform", "lower": lower, "upper": upper}
        for name, (target, lower, upper) in variables.items()
    }
    return {"format": 1, "name": "arms", "mechanism": "lever", "samples": 4, "variables": tables}


def refused(**variables):
    """Return the message with which a campaign is refused."""
    with pytest.raises(SpecError) as caught:
        load_campaign(campaign(**variables))
    return str(caught.value)


def test_the_example_of_the_page_follows_the_lever_rule(tmp_path):
    """Its force on the stop is load * long / short in every sample, and the columns have the parameters' units."""
    path = tmp_path / "arms.toml"
    path.write_text(EXAMPLE)
    loaded = load_campaign(str(path), samples=4)
    plan = make_plan(loaded)
    units = {column["name"]: column["unit"] for column in plan.columns}
    assert (units["long"], units["load"], units["hole"]) == ("mm", "N", "mm")
    for sample, values in sample_inputs(plan, range(4)):
        row = compute_row(plan, simulate, sample, values, 1, Cancel())
        assert row["status"] == "ok", row["message"]
        arms = (values["long"] - values["hole"]) / (values["short"] + values["hole"])
        assert row["force"] == pytest.approx(values["load"] * arms, rel=1e-6)


@each(
    ("variables", "said"),
    [
        (
            {"a": ("parameters.long", 29, 31), "b": ("parameters.long", 29, 31)},
            "variables.b: a and b both set parameters.long; keep one of them",
        ),
        (
            {"a": ("joints.pin.radial_clearance", 0.01, 0.1), "pin": ("pin", 0.01, 0.1)},
            "variables.pin: a and pin both set pin; keep one of them",
        ),
        (
            {"end": ("forces.load.point.x", 29, 31), "arm": ("parameters.long", 29, 31)},
            "variables.end: end sets forces.load.point.x, which follows from parameters.long (long), and arm sets",
        ),
        (
            {"time": ("simulation.horizon", 10, 20)},
            "variables.time: simulation.horizon says how a run is computed, and is the same for all; ",
        ),
        (
            {"stop": ("contacts.stop.b.plane.point.y", -0.01, 0.1)},
            "variables.stop: reaches contacts.stop.b.plane.point.y = -0.01, which lever refuses: contacts.stop: gap "
            "-0.01 mm at the start; allowed: >= 0; move the bodies, the features or `offset`; or raise its lower end",
        ),
        (
            {"pin": ("pin", 0.01, 0.3)},
            "or lower its upper end",
        ),
        (
            {"mass": ("parameters.mass", -1.0, 1.0)},
            "variables.mass: reaches parameters.mass = -1, which lever refuses: then bodies.",
        ),
        ({"arm": ("parameters.lnog", 29, 31)}, "did you mean 'parameters.long'?"),
        ({"arm": ("joints.pin.bearing.point.0", 0, 1)}, "did you mean 'joints.pin.bearing.point.x'?"),
        ({"arm": ("joints.pin.bearing.point", 0, 1)}, "inside it: joints.pin.bearing.point.x, "),
        ({"arm": ("bodies.lever.fixed", 0, 1)}, "bodies.lever.fixed: not a single number"),
        ({"arm": ("joints.pin.type", 0, 1)}, "joints.pin.type: not a single number"),
    ],
)
def test_what_is_refused(variables, said):
    """The variable, its end, what is wrong there with figures, and the remedy."""
    assert said in refused(**variables)


def test_two_components_of_one_point_do_not_overlap():
    """Nor a parameter and a number that does not follow from it."""
    variables = {f"b{axis}": (f"joints.pin.bearing.point.{axis}", -0.01, 0.01) for axis in "xy"}
    load_campaign(campaign(arm=("parameters.long", 29, 31), **variables))


def test_a_parameter_from_which_nothing_follows_on_a_bench_is_refused(tmp_path):
    """A variable without effect is a mistake; without the bench there is one."""
    bench = '\n[benches.bare]\nwithout = ["forces.load"]\n'
    text = (Path(__file__).parents[3] / "engine/mechanism/library/lever.toml").read_text()
    (tmp_path / "own.toml").write_text(text + bench)
    tables = campaign(load=("parameters.load", 3.0, 5.0)) | {"mechanism": str(tmp_path / "own.toml")}
    load_campaign(tables)
    with pytest.raises(SpecError, match=r"variables\.load.*parameters\.load"):
        load_campaign(tables | {"bench": "bare"})
