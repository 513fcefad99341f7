"""What a report lists as fixed: contact laws, clearances, loads, masses and settings, and nothing that varies."""

from dataclasses import replace

import pytest

from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from clearcap.questions.fixed_assumptions import fixed_assumptions
from engine.mechanism import get_value, load_mechanism, set_values, unit_of
from engine.mechanism.joints import AngleLimits
from tests.engine.small import made
from tests.engine.test_couplings import wheels
from tests.engine.test_rolling_friction import ARM, ball


@pytest.fixture
def by_key(plan):
    """Return the assumptions of the small campaign by their key."""
    return {each.key: each for each in fixed_assumptions(plan)}


def test_each_has_the_value_and_the_unit_of_its_key(plan, by_key):
    """A number of the table is the one that the runs have."""
    numbers = {key: each for key, each in by_key.items() if key and isinstance(each.value, float)}
    assert len(numbers) > 20
    for key, each in numbers.items():
        assert each.value == get_value(plan.mechanism, key), key
        assert each.unit == unit_of(plan.mechanism, key), key


def test_friction_springs_masses_and_settings_are_there(by_key):
    """What a reviewer asks for first."""
    assert by_key["materials.steel_plastic.friction"].value == 0.1
    assert "J2, J5, J6, J7, S3" in by_key["materials.steel_plastic.friction"].name
    assert (by_key["springs.A2.stiffness"].value, by_key["springs.A2.stiffness"].unit) == (1.16, "N/mm")
    assert by_key["bodies.handle.mass"].unit == "g"
    assert by_key["gravity"].value == (0.0, 0.0, 0.0)
    assert {"units", "simulation.step", "simulation.rest.window", "joints.J2.radial_clearance"} <= by_key.keys()


def test_what_varies_is_not_there(by_key):
    """Whether a variable names a joint or a dotted path."""
    assert "joints.J1.radial_clearance" not in by_key
    assert "springs.A3.preload" not in by_key
    assert "springs.A3.stiffness" in by_key


def test_a_component_that_varies_leaves_the_others(plan):
    """Of a vector only the component that a variable sets is left out."""
    spec = plan.spec.model_copy(
        update={"variables": {"g": plan.spec.variables["preload"].model_copy(update={"target": "gravity.y"})}}
    )
    keys = {each.key: each.value for each in fixed_assumptions(replace(plan, spec=spec))}
    assert keys["gravity.x"] == keys["gravity.z"] == 0.0
    assert "gravity" not in keys
    assert "gravity.y" not in keys


def test_the_campaigns_own_settings_replace_the_mechanisms(campaign_file):
    """Step, horizon and tolerance are those of the runs."""
    text = "[simulation]\nstep = 1e-3\nhorizon = 12.5\ntolerance = 1e-7\n\n[variables.J1]"
    campaign_file.write_text(campaign_file.read_text().replace("[variables.J1]", text))
    by_key = {each.key: each for each in fixed_assumptions(make_plan(load_campaign(str(campaign_file))))}
    settings = [by_key[f"simulation.{name}"].value for name in ("step", "horizon", "tolerance")]
    assert settings == [1e-3, 12.5, 1e-7]
    assert by_key["simulation.step"].name == "time step"
    assert "simulation.adaptive.longest" not in by_key


def test_a_preset_is_named_and_its_values_are_there():
    """The campaign in free fall says so, and its drag is none."""
    plan = make_plan(load_campaign("c60_paper"))
    assert [each.value for each in fixed_assumptions(plan) if each.name == "preset"] == ["paper"]
    assert get_value(plan.mechanism, "phases.0.damping") == 0.0
    assert not [each for each in fixed_assumptions(make_plan(load_campaign("c60"))) if each.name == "preset"]


def test_what_follows_from_a_parameter_that_varies_is_not_fixed(campaign_file):
    """The load of the lever varies, and with it one component of a force; its arms are fixed parameters."""
    text = campaign_file.read_text().replace('"c60"', '"lever"').replace("springs.A3.preload", "parameters.load")
    head, _, rest = text.partition("[variables.J1]")
    campaign_file.write_text(
        head + "[variables.preload]" + rest.partition("[variables.preload]")[2].partition("[resp")[0]
    )
    by_key = {each.key: each for each in fixed_assumptions(make_plan(load_campaign(str(campaign_file))))}
    assert (by_key["parameters.long"].value, by_key["parameters.long"].unit) == (30.0, "mm")
    assert "parameters.load" not in by_key
    assert {"forces.load.force.x", "forces.load.force.z"} <= by_key.keys()
    assert "forces.load.force.y" not in by_key


def test_friction_of_ideal_joints_and_backlash_are_there(plan):
    """A force or torque in its unit; what a law has is its number of points."""
    mechanism = made(wheels(backlash=0.01))
    mechanism = set_values(mechanism, {"couplings.mesh.backlash": 0.02})
    shaft = mechanism.joints["first"].model_copy(update={"friction_torque": 0.3})
    mechanism = mechanism.model_copy(update={"joints": {**mechanism.joints, "first": shaft}})
    spec = plan.spec.model_copy(update={"variables": {}, "responses": {}})
    found = fixed_assumptions(replace(plan, spec=spec, mechanism=mechanism))
    by_key = {each.key: each for each in found}
    assert (by_key["joints.first.friction_torque"].value, by_key["joints.first.friction_torque"].unit) == (0.3, "N m")
    assert by_key["couplings.mesh.backlash"].value == 0.02
    stop = mechanism.joints["second"].model_copy(
        update={"limits": AngleLimits(lower=-1.0, upper=1.0, stiffness=7.0, damping=0.1)}
    )
    springy = mechanism.model_copy(update={"joints": {**mechanism.joints, "second": stop}})
    by_key = {each.key: each for each in fixed_assumptions(replace(plan, spec=spec, mechanism=springy))}
    assert by_key["joints.second.limits.stiffness"].value == 7.0
    assert by_key["joints.second.limits.damping"].unit == "N m s/rad"
    button = fixed_assumptions(replace(plan, spec=spec, mechanism=load_mechanism("push_button")))
    assert {each.key: each.value for each in button}["springs.dome.law.table"] == "5 points"


def test_what_resists_rolling_and_friction_over_speed_are_there(plan):
    """An arm is a length, of a contact or a material; a table is its number of points."""
    data = ball()
    data["materials"] = {"oiled": {"friction": 0.2, "friction_over_speed": {"table": [[0, 2], [1, 1]]}}}
    data["materials"]["oiled"]["spinning_friction"] = 0.003
    spec = plan.spec.model_copy(update={"variables": {}, "responses": {}})
    by_key = {each.key: each for each in fixed_assumptions(replace(plan, spec=spec, mechanism=made(data)))}
    assert (by_key["contacts.touch.rolling_friction"].value, by_key["contacts.touch.rolling_friction"].unit) == (
        ARM,
        "m",
    )
    assert by_key["materials.oiled.spinning_friction"].value == 0.003
    assert by_key["materials.oiled.friction_over_speed.table"].value == "2 points"
