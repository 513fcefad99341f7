"""The C-60 as its authors published it: the file against the published numbers, and the trip it makes."""

import numpy as np
import pytest

from engine import load_mechanism, simulate
from engine.assembly import assemble
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.loads import apply_loads
from tests.engine.small import made, shipped

# "gap ON" of the public model, measured there by the CAD kernel between bounded patches
PUBLISHED = {
    "J1_bot": 0.021,
    "J1_top": 0.04099,
    "C1_1": 0.023029,
    "C1_2": 0.002561,
    "C1_3": 0.003843,
    "C1_4": 0.023894,
    "S3_bot": 0.005978,
    "S3_top": 0.005978,
    "J2.ring1": 0.02094,
    "J2.ring2": 0.02094,
    "J3.ring1": 0.01505,
    "J3.ring2": 0.01505,
    "J4.ring1": 0.01393,
    "J4.ring2": 0.01393,
    "C4_1": 0.007111,
    "C4_2": 0.007111,
    "C4_3": 0.017294,
    "C4_4": 0.017294,
    "J5.ring1": 0.01168,
    "J5.ring2": 0.01168,
    "J6.ring1": 0.02098,
    "J6.ring2": 0.02098,
    "J7.ring1": 0.02098,
    "J7.ring2": 0.02099,
    "C7": 0.038603,
    "C3_1": 3.858436,
    "C3_2": 3.831985,
    "C3_3": 4.724650,
    "C3_4": 4.114545,
    "C5_1": 0.019465,
    "C5_2": 0.019465,
    "C6_1": 1.146068,
    "C6_2": 1.146068,
    "C6_3": 1.037034,
    "C6_4": 1.037034,
    "TRIP_1": 0.846782,
    "TRIP_2": 0.379133,
    "FC6_plane": 0.388155,
    "guide_front": 0.098975,
    "guide_back": 0.098975,
}
ABOUT_THE_AXIS = {
    # N mm about z at ON, by the springs: on the handle about J1, on plate and moving contact about the needle
    "handle": ([-16.1, 10.0, 0.0], 27.1307),
    "plate": ([0.0, 0.0, 0.0], 74.6 + 188.8131),
    "moving_contact": ([0.0, 0.0, 0.0], -149.0790),
}


def test_every_gap_at_the_start_is_the_published_one():
    """All 39 pairs of the public list; the plunger's guide is two points here."""
    assembly = assemble(load_mechanism("c60_public"))
    work, state = assembly.work, assembly.state
    find_contacts(assembly.model.contacts, state.x, state.R, work.gap, work.sites.point, work.sites.frame)
    assert dict(zip(assembly.contact_names, work.gap, strict=True)) == pytest.approx(PUBLISHED, abs=1e-4)


def test_springs_act_as_published():
    """Moments about the axes at ON, with the arms and the imbalance of the public file."""
    mechanism = load_mechanism("c60_public")
    assembly = assemble(mechanism)
    model, state, work = assembly.model, assembly.state, assembly.work
    apply_loads(model.bodies, model.loads, model.time_laws, state, 1, 0.0, work.wrench, work.vectors)
    masses = model.bodies.mass.tolist()
    for name, (axis, moment) in ABOUT_THE_AXIS.items():
        body = masses.index(mechanism.bodies[name].mass)
        force, torque = work.wrench[body, :3], work.wrench[body, 3:]
        found = torque[2] + np.cross(state.x[body] - axis, force)[2]
        assert found == pytest.approx(moment, abs=0.1), name


@pytest.fixture(scope="module")
def trips():
    """Run it with its own scheme, and with positions projected and the steps of c60."""
    combined = shipped("c60_public")
    combined["simulation"] |= {"scheme": "combined", "step": 2e-3, "tolerance": 1e-9}
    combined["simulation"]["adaptive"] = {"longest": 0.032, "travel": 8e-3}
    return simulate(load_mechanism("c60_public")), simulate(made(combined))


def test_the_plunger_trips_it(trips):
    """On with the force of the hand calculation, released after about the way of the kinematic estimate, then open.

    The hand calculation: 7.51 N without friction in C7. The kinematic estimate, 0.965 mm, is from the unloaded pose:
    closing the clearances takes the bar another 0.12 mm away from the plunger, and the hook 0.02 mm further onto it.
    """
    for run in trips:
        assert run.status == "ok", run.message
        r = run.responses
        assert r["FC-1"] == pytest.approx(7.5, abs=0.3)
        away = r["FC-6"] - 0.3891
        assert 0.1 < away < 0.15
        assert r["release_travel"] == pytest.approx(0.965 + away, abs=0.1)
        assert r["release_time"] == pytest.approx(0.7 + r["release_travel"] / 0.2, abs=2e-3)
        assert 0 < r["opening_time"] - r["release_time"] < 1
        assert r["contact_gap"] > 4.5


def test_the_schemes_agree_on_the_trip(trips):
    """Plain and combined: the same release and opening, within 0.05 ms; only the plain one sinks in."""
    plain, combined = trips
    for name, within in {"FC-1": 0.1, "FC-6": 0.02, "release_time": 0.05, "opening_time": 0.05}.items():
        assert plain.responses[name] == pytest.approx(combined.responses[name], abs=within)
    assert combined.certificate.max_penetration <= 1e-8 < plain.certificate.max_penetration < 0.003
