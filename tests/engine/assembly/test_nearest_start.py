"""The assembly step: the nearest start pose without overlap; closed forms, scipy, a thousand random overlaps."""

import copy
from collections import Counter
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from engine import MechanismError, NotAssemblable, load_mechanism, set_values, simulate
from engine.assembly import Assembly, assemble
from engine.assembly.frames import order_bodies
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.mechanism import Mechanism
from tests.engine.small import block_on_floor, made, place, shipped, small

MASS = 2.0
INERTIA = [0.03, 0.05, 0.07]


def free(data: dict[str, Any], travel: float) -> dict[str, Any]:
    """Allow bodies to be moved so far."""
    data = copy.deepcopy(data)
    data["simulation"]["assembly_travel"] = travel
    return data


def ball(off: Any, arm: Any = (0, 0, 0), clearance: float = 0.01) -> dict[str, Any]:
    """Describe a body whose ball, ``arm`` from its centre of mass, is ``off`` the middle of a fixed socket."""
    joint = {
        "type": "clearance_spherical",
        "socket": {"body": "ground", "point": [1, 1, 1]},
        "ball": {"body": "part", "point": list(arm), "radius": 0.2},
        "radial_clearance": clearance,
        "friction": 0.1,
    }
    origin = np.array([1.0, 1.0, 1.0]) + off - np.array(arm)
    bodies = {"ground": {"fixed": True}, "part": {"mass": MASS, "inertia": INERTIA, "origin": origin.tolist()}}
    return free(small(bodies=bodies, joints={"J": joint}), 0.5)


def test_a_ball_moves_by_what_it_is_too_far_off():
    """With the ball at the centre of mass nothing turns: the displacement is the eccentricity less the clearance."""
    off = np.array([0.03, -0.04, 0.12])
    assembly = assemble(made(ball(off)))
    assert assembly.travel == pytest.approx(0.13 - 0.01, rel=1e-9)
    np.testing.assert_allclose(assembly.state.x[0], 1.0 + off * (0.01 / 0.13), atol=1e-9)
    np.testing.assert_allclose(assembly.state.R[0], np.eye(3), atol=1e-9)


def test_on_an_arm_it_moves_and_turns_as_the_mass_metric_says():
    """To first order: s = p (1/m + L^2/I) at the ball, and a root mean square displacement of s / sqrt(1 + m L^2/I)."""
    excess, arm = 1e-5, 0.4
    assembly = assemble(made(ball([0, 0.01 + excess, 0], arm=(arm, 0, 0))))
    give = 1 / MASS + arm**2 / INERTIA[2]
    assert assembly.travel == pytest.approx(excess / np.sqrt(MASS * give), rel=1e-3)
    np.testing.assert_allclose(assembly.state.x[0, 1] - 1.01 - excess, -excess / give / MASS, rtol=1e-3)


@pytest.mark.parametrize("depth", [1e-5, 5e-3])
def test_a_block_rises_from_the_floor(depth):
    """All lower corners by the same depth: straight up, and the run goes on from there."""
    data = free(block_on_floor(origin=[0, 0, 0.1 - depth]), 0.01)
    run = simulate(made(data))
    assert run.status == "ok"
    assert run.certificate.start_travel == pytest.approx(depth, rel=1e-6)
    assert run.responses["z"] == pytest.approx(0.1, abs=1e-6)


def test_a_pose_that_is_free_is_left_as_drawn():
    """To the last bit, whatever may be moved."""
    for name in ("clearance_pendulum", "four_bar", "double_pendulum"):
        drawn = assemble(load_mechanism(name))
        allowed = assemble(set_values(made(free(shipped(name), 1.0)), {}))
        assert (drawn.travel, allowed.travel) == (0.0, 0.0)
        assert all((a == b).all() for a, b in zip(drawn.state, allowed.state, strict=True))


def displaced(name: str, rng: np.random.Generator, *, only_play: bool = False) -> Mechanism:
    """Return a shipped mechanism with bodies, and bores and their axes, off by about twice the play, at random.

    For ``four_bar``, whose play is a hundredth of the others', the tilts alone often leave no pose. With ``only_play``
    it has no ideal joint and no motion.
    """
    shift, point, tilt, travel = AMOUNTS[name]
    data, kind = free(shipped(name), travel), rng.integers(3)
    if only_play:
        data.pop("motions", None)
        data["joints"] = {key: joint for key, joint in data["joints"].items() if joint["type"] != "revolute"}
    for body in data["bodies"].values():
        if kind != 1 and not body.get("fixed"):
            body["origin"] = off(body.get("origin", [0.0, 0.0, 0.0]), shift * rng.standard_normal(3))
    for joint in data.get("joints", {}).values():
        side = joint.get("bearing") or joint.get("guide")
        if kind > 0 and side:
            side["point"] = off(side["point"], point * rng.standard_normal(3))
            if kind == 2 and tilt and "axis" in side:
                side["axis"] = off(side["axis"], tilt * rng.standard_normal(3))
    return made(data)


def off(place: list[Any], by: Any) -> list[Any]:
    """Add a displacement to the coordinates that are numbers."""
    return [x if isinstance(x, str) else float(x + d) for x, d in zip(place, by, strict=True)]


# displacement of the bodies, of the bores, tilt of their axes, and how far a body may move
AMOUNTS = {
    "c60": (0.05, 0.08, 0.01, 0.5),
    "c60_public": (0.05, 0.08, 0.01, 0.5),
    "four_bar": (1.5e-4, 2e-4, 0.01, 3e-3),
    "chain": (1.5e-3, 2e-3, 0.05, 0.05),
    "clearance_pendulum": (5e-4, 5e-4, 0.01, 0.02),
    "lever": (0.05, 0.05, 0.01, 0.5),
    "slider_crank": (5e-4, 1e-4, 0.0, 5e-3),
}


def outcome(mechanism: Mechanism) -> str:
    """Return how the assembly step ends; check that a pose it finds is free, near and not the drawn one."""
    sim = mechanism.simulation
    try:
        assembly = assemble(mechanism)
    except NotAssemblable as error:
        return "impossible" if "was found" not in error.reason else "not found"
    contacts, state, sites = assembly.model.contacts, assembly.state, assembly.work.sites
    gap = np.zeros_like(state.gap)
    find_contacts(contacts, state.x, state.R, gap, sites.point, sites.frame)
    assert gap.min(initial=0.0) >= -sim.penetration
    assert assembly.travel <= (sim.assembly_travel or 0.0)
    return "moved" if assembly.travel else "free as drawn"


def overlaps(each: int, seed: int) -> Counter[str]:
    """Return how the assembly step ends for so many random overlaps of each shipped mechanism."""
    return Counter(outcome(displaced(name, np.random.default_rng([seed, i]))) for name in AMOUNTS for i in range(each))


def test_fifty_random_overlaps_are_solved_or_proved_impossible():
    """No search ends without an answer, and most find a pose."""
    found = overlaps(8, 1)
    assert found["not found"] == 0
    assert found["moved"] > 35


@pytest.mark.slow
def test_a_thousand_random_overlaps_are_solved_or_proved_impossible():
    """As above, with other overlaps."""
    found = overlaps(160, 2)
    assert sum(found.values()) - found["free as drawn"] >= 1000
    assert found["not found"] == 0


class Poses:
    """The gaps of a mechanism as a function of w, the displacements times the root of the mass matrix."""

    def __init__(self, mechanism: Mechanism) -> None:
        open_wide = {"simulation.penetration": 1e3, "simulation.joint_violation": 1e3}
        self.assembly: Assembly = assemble(set_values(mechanism, open_wide))
        bodies, state = self.assembly.model.bodies, self.assembly.state
        self.x, self.R = state.x.copy(), [Rotation.from_matrix(R) for R in state.R]
        self.root = np.sqrt(bodies.mass), np.linalg.cholesky(bodies.inertia)

    def gaps(self, w: Any) -> Any:
        """Return the gaps at w."""
        assembly, sites = self.assembly, self.assembly.work.sites
        for i, part in enumerate(np.reshape(w, (-1, 6))):
            turn = Rotation.from_rotvec(np.linalg.solve(self.root[1][i].T, part[3:]))
            place(assembly, i, self.x[i] + part[:3] / self.root[0][i], self.R[i] * turn)
        gap = np.zeros_like(assembly.state.gap)
        find_contacts(assembly.model.contacts, assembly.state.x, assembly.state.R, gap, sites.point, sites.frame)
        return gap

    def w(self, assembly: Assembly) -> Any:
        """Return the w of another pose."""
        found = []
        for i in range(len(self.root[0])):
            turn = (self.R[i].inv() * Rotation.from_matrix(assembly.state.R[i])).as_rotvec()
            found += [*(assembly.state.x[i] - self.x[i]) * self.root[0][i], *(self.root[1][i].T @ turn)]
        return np.array(found)


@pytest.mark.parametrize(("name", "seeds"), [("clearance_pendulum", range(6)), ("four_bar", [1]), ("lever", range(4))])
def test_no_other_pose_is_nearer_in_the_mass_metric(name, seeds):
    """The minimum that scipy finds (SLSQP, differences for gradients) is no shorter, and is the same pose."""
    for seed in seeds:
        mechanism = displaced(name, np.random.default_rng([9, seed]), only_play=True)
        poses, found = Poses(mechanism), assemble(mechanism)
        w = poses.w(found)
        size = float(np.linalg.norm(w)) or 1.0
        options = {"maxiter": 300, "ftol": 1e-14}
        limits = {"type": "ineq", "fun": lambda v, poses=poses, size=size: poses.gaps(v * size) / size}
        best = minimize(
            lambda v: 0.5 * v @ v, w / size, jac=lambda v: v, constraints=limits, method="SLSQP", options=options
        )
        assert best.fun >= 0.5 * (w @ w) / size**2 * (1 - 1e-4)
        np.testing.assert_allclose(best.x * size, w, atol=2e-2 * size)


def test_a_bore_off_its_true_position_starts_where_its_play_lets_it():
    """Distance and direction as two parameters: within the play nothing moves, beyond it the link follows."""
    data = free(shipped("clearance_pendulum"), 0.01)
    data["parameters"] = {"off": 0.0, "way": 0.0}
    side = data["joints"]["J1"]["bearing"]
    x, y, z = side["point"]
    side["point"] = [f"{x} + off * cos(way)", f"{y} + off * sin(way)", z]
    mechanism, play = made(data), data["joints"]["J1"]["radial_clearance"]
    for way in (0.0, 2.0):
        inside = set_values(mechanism, {"parameters.off": 0.9 * play, "parameters.way": way})
        assert assemble(inside).travel == 0.0
        beyond = assemble(set_values(mechanism, {"parameters.off": 3.0 * play, "parameters.way": way}))
        assert 0.0 < beyond.travel <= 2.0 * play * (1 + 1e-6)
        assert beyond.state.gap.min() >= -mechanism.simulation.penetration


def test_parts_that_are_too_long_are_proved_impossible_with_the_pair():
    """A block 0.2 high between a floor and a ceiling 0.19 apart: no displacement helps, both contacts are named."""
    data = free(block_on_floor(origin=[0, 0, 0.1]), 0.05)
    for i in (1, 3, 5, 7):
        ceiling = {"point": [0, 0, 0.19], "normal": [0, 0, -1]}
        data["contacts"][f"top_{i}"] = {**data["contacts"][f"corner_{i}"], "b": {"body": "ground", "plane": ceiling}}
    with pytest.raises(NotAssemblable, match="parts overlap at the start pose") as caught:
        assemble(made(data))
    reason = caught.value.reason
    assert "no pose within simulation.assembly_travel = 0.05 m" in reason
    assert reason.startswith("block and ground (contacts.")
    assert isinstance(caught.value, MechanismError)


def test_a_pose_beyond_the_limit_is_refused_with_its_distance():
    """And a limit of 0 leaves everything as drawn: an overlap is refused as it is."""
    data = free(block_on_floor(origin=[0, 0, 0.09]), 0.009)
    with pytest.raises(NotAssemblable) as caught:
        assemble(made(data))
    assert caught.value.reason == (
        "the nearest pose without overlap moves block by 0.01 m; allowed: simulation.assembly_travel = 0.009 m"
    )
    with pytest.raises(NotAssemblable, match=r"gap -0\.01 m at the start") as caught:
        assemble(made(free(data, 0.0)))
    assert "assembly_travel" not in str(caught.value)


def four_bar(**lengths: float) -> dict[str, Any]:
    """Describe a four-bar linkage of ideal pins, drawn for links of 0.1, 0.26 and 0.2 m, with other lengths."""
    data = free(shipped("four_bar"), 0.02)
    links = {"crank": 0.1, "coupler": 0.26} | lengths
    for name, pin in (("J1", "crank"), ("J2", "coupler")):
        joint = data["joints"][name]
        joint["journal"]["point"] = [links[pin], 0.0, 0.0]
    for name in ("J1", "J2", "J3"):
        joint = data["joints"][name]
        data["joints"][name] = {"type": "revolute"} | {
            side: {key: joint[side][key] for key in ("body", "point", "axis")} for side in ("bearing", "journal")
        }
    return data


def test_a_loop_of_ideal_joints_closes_when_a_link_gets_longer():
    """Freudenstein's equation for the new lengths holds, and the driven crank stays at its angle, friction or not."""
    for lengths in ({"coupler": 0.262}, {"crank": 0.1015, "coupler": 0.258}):
        data = four_bar(**lengths)
        if "crank" in lengths:
            data["joints"]["J2"]["friction_torque"] = 0.1
        mechanism = made(data)
        assembly = assemble(mechanism)
        crank, coupler = lengths.get("crank", 0.1), lengths["coupler"]
        angle = {
            name: Rotation.from_matrix(R).as_rotvec()[2]
            for name, R in zip(order_bodies(mechanism), assembly.state.R[:3], strict=True)
        }
        assert angle["crank"] == pytest.approx(np.pi / 2, abs=1e-9)
        ends = [
            crank * np.exp(1j * angle["crank"]) + coupler * np.exp(1j * angle["coupler"]),
            0.3 + 0.2 * np.exp(1j * angle["rocker"]),
        ]
        assert abs(ends[0] - ends[1]) < 1e-7
        assert 0 < assembly.travel < 0.005


def test_a_loop_that_cannot_close_is_refused_with_its_open_joint():
    """A coupler of 1 m reaches no rocker: the joint that stays open is named."""
    data = four_bar(coupler=1.0)
    with pytest.raises(NotAssemblable, match="joints are open at the start pose") as caught:
        assemble(made(data))
    assert "cannot be closed: no pose" in caught.value.reason
