"""Bushings and beams: closed forms, Euler and Bernoulli's matrix, the energy account, and steps of any length."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine import read_trajectory, simulate
from engine.assembly import assemble
from engine.errors import MechanismError
from engine.kernels.loads import apply_loads, potential_energy
from engine.mechanism import set_values, settable_keys
from tests.each import each
from tests.engine.small import FLOOR, GRAVITY, coordinates, made, place, small, turned

MASS, INERTIA = 2.0, (0.3, 0.4, 0.5)
ALONG, ABOUT = (2000.0, 3000.0, 5000.0), (30.0, 50.0, 80.0)


def hung(duration: float | None = None, step: float = 1e-3, **joint: Any) -> dict[str, Any]:
    """Describe a body on a bushing at its centre, without gravity."""
    side = {"body": "ground", "point": [0, 0, 0]}
    return small(
        phases=[{"name": "run", "duration": duration}] if duration else [{"name": "settle"}],
        simulation={"horizon": 100.0, "step": step},
        bodies={"ground": {"fixed": True}, "load": {"mass": MASS, "inertia": list(INERTIA)}},
        joints={
            "mount": {
                "type": "bushing",
                "a": side,
                "b": {**side, "body": "load"},
                "stiffness": list(ALONG),
                "torsional_stiffness": list(ABOUT),
                **joint,
            }
        },
        responses=coordinates("load")
        | {
            f"turn_{axis}": {"type": "angle", "body": "load", "axis": vector}
            for axis, vector in zip("xyz", np.eye(3).tolist(), strict=True)
        }
        | {
            "force": {"type": "joint_force", "joint": "mount"},
            "torque": {"type": "joint_torque", "joint": "mount"},
        },
    )


@pytest.mark.parametrize("k", range(6))
def test_a_body_swings_in_each_direction_with_its_own_period(k):
    """It is at v sin(w t) / w, to second order in the step, and v again after a period; nothing is lost."""
    stiffness, inert = (ALONG + ABOUT)[k], (MASS,) * 3 + INERTIA
    omega, wrong = np.sqrt(stiffness / inert[k]), []
    for step in (2e-3, 1e-3):
        data = hung(0.12, step)
        velocity = [0.0, 0.0, 0.0]
        velocity[k % 3] = 1.0
        data["bodies"]["load"] |= {"velocity" if k < 3 else "angular_velocity": velocity}
        run = simulate(made(data))
        assert run.status == "ok", run.message
        found = run.responses[["x", "y", "z", "turn_x", "turn_y", "turn_z"][k]]
        assert found == pytest.approx(np.sin(0.12 * omega) / omega, rel=0.05)
        effort = run.responses["force" if k < 3 else "torque"]
        middle = np.sin((0.12 - step / 2) * omega) / omega
        assert effort == pytest.approx(stiffness * abs(middle), rel=0.1)
        assert abs(run.certificate.lost_energy) < 1e-12
        wrong.append(abs(found - np.sin(0.12 * omega) / omega))
    assert wrong[0] == pytest.approx(4 * wrong[1], rel=0.2)


@each("share", [0.05, 0.7, 3.0])
def test_damping_is_that_of_an_oscillator(share):
    """Below, near and above the critical one."""
    omega, t = np.sqrt(ALONG[0] / MASS), 0.1
    rate = share * omega
    data = hung(t, 2e-4, damping=[2 * MASS * rate, 0.0, 0.0])
    data["bodies"]["load"]["velocity"] = [1.0, 0.0, 0.0]
    run = simulate(made(data))
    root = np.sqrt(complex(rate**2 - omega**2))
    expected = (np.exp(-rate * t) * np.sinh(root * t) / root).real
    assert run.responses["x"] == pytest.approx(expected, rel=2e-3)
    assert abs(run.certificate.lost_energy) < 1e-3


def test_the_force_is_the_slope_of_the_energy_at_any_angle():
    """Loads are minus the gradient of the potential energy, for both bodies moved and turned at will."""
    data = hung(axis=[1.0, 2.0, 0.5], normal=[2.0, -1.0, 0.0])
    data["bodies"]["other"] = {
        "mass": 3.0,
        "inertia": [1, 2, 2],
        "axis": [1, 0, 1],
        "angle": 0.4,
        "origin": [0.1, 0, 0],
    }
    data["joints"]["mount"]["a"] = {"body": "other", "point": [0.2, 0.1, -0.3]}
    arrays = assemble(made(data))
    model, state = arrays.model, arrays.state
    random = np.random.default_rng(3)
    turns = [Rotation.from_rotvec(random.uniform(-1.0, 1.0, 3)) for _ in range(2)]
    places = random.uniform(-0.3, 0.3, (2, 3))

    def held(w):
        for body in range(2):
            shift, turn = w[6 * body : 6 * body + 3], Rotation.from_rotvec(w[6 * body + 3 : 6 * body + 6])
            place(arrays, body, places[body] + shift, turn * turns[body])
        return potential_energy(model.bodies, model.loads, model.time_laws, state)

    w, step = np.zeros(12), 1e-5
    slope = [(held(w + step * e) - held(w - step * e)) / (2 * step) for e in np.eye(12)]
    held(w)
    apply_loads(model.bodies, model.loads, model.time_laws, state, 0, 0.0, arrays.work.wrench, arrays.work.vectors)
    assert arrays.work.wrench[:2].ravel() == pytest.approx(-np.array(slope), rel=1e-6, abs=1e-5)


def recorded(data: dict[str, Any], folder: Any) -> Any:
    """Return the trajectory of a run that ends well."""
    run = simulate(made(data), trajectory=folder / "run.h5")
    assert run.status == "ok", run.message
    return read_trajectory(folder / "run.h5")


def test_a_tumbling_body_keeps_its_energy(tmp_path):
    """With three stiffnesses, and angles of more than 1 rad about no axis of the frame: to second order."""
    off = []
    for step in (2e-3, 1e-3):
        data = hung(0.3, step)
        data["bodies"]["load"] |= {"angular_velocity": [12.0, 9.0, -7.0], "velocity": [1.0, -2.0, 0.5]}
        motion = recorded(data, tmp_path)
        whole = motion.kinetic + motion.potential
        assert motion.potential.max() > 0.5 * whole[0]
        off.append(np.abs(whole - whole[0]).max())
    assert off[0] < 5e-3 * whole[0]
    assert off[1] < 0.35 * off[0]


def test_what_dampers_take_is_missing(tmp_path):
    """Kinetic energy, that of the springs, and the integral of d v^2 add up in each step."""
    data = hung(0.2, 1e-3, damping=[20.0, 0.0, 0.0])
    data["bodies"]["load"]["velocity"] = [1.0, 0.0, 0.0]
    motion = recorded(data, tmp_path)
    speed = motion.bodies["load"].velocity[:, 0]
    mean = 0.5 * (speed[1:] + speed[:-1])
    taken = np.cumsum(20.0 * mean**2 * np.diff(motion.time))
    assert (motion.kinetic + motion.potential)[1:] + taken == pytest.approx(0.5 * MASS, rel=1e-9)


@pytest.mark.parametrize("step", [1e-3, 0.05, 1.0])
def test_a_weight_rests_on_its_bushing_whatever_the_step(step):
    """It sags by m g / k, also with steps of some periods, and the bushing reports its weight."""
    data = hung(step=step, damping=[100.0] * 3, torsional_damping=[10.0] * 3)
    data["gravity"] = [0, 0, -GRAVITY]
    data["simulation"]["rest"] = {"window": max(0.1, 4 * step), "drift": 1e-8}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(-MASS * GRAVITY / ALONG[2], abs=1e-7)
    assert run.responses["force"] == pytest.approx(MASS * GRAVITY, rel=1e-4)


@each(("stiffness", "damping"), [(ABOUT[2], 4.0), (0.0, 2.0)])
def test_what_still_turns_on_its_bushing_is_not_at_rest(stiffness, damping):
    """Only its height is measured, which never changes: it turns about z, as an oscillator or in a damper alone."""
    data = hung(step=5e-3, torsional_stiffness=[*ABOUT[:2], stiffness], torsional_damping=[0.0, 0.0, damping])
    data["bodies"]["load"]["angular_velocity"] = [0, 0, 1.0]
    data["responses"] = {"z": data["responses"]["z"], "torque": data["responses"]["torque"]}
    data["simulation"]["rest"] = {"window": 0.3, "drift": 1e-4}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.certificate.time > np.log(1e3) * INERTIA[2] / damping
    assert run.responses["torque"] < 2e-4 * (stiffness + damping / 0.3)


def test_a_stiff_bushing_is_a_fixed_joint():
    """A pendulum of two bodies, swinging: its lower part is where a fixed joint has it, to second order in the step."""

    def end(type_, step):
        data = hung(0.3, step, stiffness=[1e9] * 3, torsional_stiffness=[1e8] * 3)
        data["gravity"] = [0, 0, -GRAVITY]
        if type_ == "fixed":
            data["joints"]["mount"] = {key: data["joints"]["mount"][key] for key in ("a", "b")} | {"type": "fixed"}
            data["responses"] = coordinates("load")
        data["joints"]["mount"]["a"] = {"body": "upper", "point": [0.5, 0, 0]}
        data["bodies"]["load"]["origin"] = [0.5, 0, 0]
        data["bodies"]["upper"] = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1], "origin": [0, 0, 0]}
        data["joints"]["hinge"] = {
            "type": "revolute",
            "bearing": {"body": "ground", "point": [0, 0, 0], "axis": [0, 1, 0]},
            "journal": {"body": "upper", "point": [0, 0, 0], "axis": [0, 1, 0]},
        }
        run = simulate(made(data))
        assert run.status == "ok", run.message
        return np.array([run.responses[axis] for axis in "xyz"])

    off = [np.abs(end("bushing", step) - end("fixed", step)).max() for step in (4e-3, 2e-3)]
    assert off[0] < 5e-5
    assert off[1] < 0.35 * off[0]


def test_a_preload_presses_a_contact():
    """Points drawn 10 mm apart press a block on a floor with k times that, and with friction it holds a pull."""
    data = hung(damping=[0.0, 0.0, 50.0])
    data["joints"]["mount"]["a"]["point"] = [0, 0, -0.01]
    data["joints"]["mount"]["stiffness"][:2] = [0.0, 0.0]
    data["contacts"] = {
        f"foot_{i}": {
            "a": {"body": "load", "point": [*corner, 0]},
            "b": {"body": "ground", "plane": FLOOR},
            "friction": 0.5,
        }
        for i, corner in enumerate([(0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.1, -0.1)])
    }
    data["forces"] = {"pull": {"body": "load", "force": [20.0, 0, 0]}}
    data["responses"] |= {c: {"type": "contact_force", "contact": c} for c in data["contacts"]}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert sum(run.responses[c] for c in data["contacts"]) == pytest.approx(0.01 * ALONG[2], rel=1e-6)
    assert run.responses["x"] == pytest.approx(0.0, abs=1e-9)
    data["forces"]["pull"]["force"] = [26.0, 0, 0]
    data["phases"] = [{"name": "run", "duration": 0.1}]
    slides = simulate(made(data))
    assert slides.responses["x"] == pytest.approx(0.5 * (26.0 - 25.0) / MASS * 0.1**2, rel=1e-3)


def test_nothing_depends_on_place_order_or_side():
    """The same motion elsewhere, with another order of bodies, and, while angles are small, with the sides swapped."""
    data = hung(0.1, torsional_damping=[0.1] * 3)
    data["bodies"]["other"] = {"mass": 3.0, "inertia": [1, 2, 2], "origin": [0, 0, 0.2], "velocity": [1e-3, 0, 2e-3]}
    data["joints"]["second"] = data["joints"]["mount"] | {
        "a": {"body": "load", "point": [0, 0, 0.1]},
        "b": {"body": "other", "point": [0, 0, -0.1]},
    }
    data["responses"] = coordinates("other") | {"force": data["responses"]["force"]}
    first = simulate(made(data))
    there = simulate(made(turned(data, Rotation.from_rotvec([0.3, -1.0, 0.7]), np.zeros(3))))
    swapped = data | {"bodies": dict(reversed(data["bodies"].items()))}
    ordered = simulate(made(swapped))
    data["joints"]["second"] |= {"a": data["joints"]["second"]["b"], "b": data["joints"]["second"]["a"]}
    other_side = simulate(made(data))
    for run, share in ((there, 1e-9), (ordered, 1e-9), (other_side, 1e-3)):
        assert run.responses == {
            key: pytest.approx(value, rel=share, abs=share * 1e-4) for key, value in first.responses.items()
        }


# Beams.

E, NU, LENGTH, WIDTH, THICK = 2.0e11, 0.3, 0.2, 0.02, 0.002
AREA, SOFT, STIFF = WIDTH * THICK, WIDTH * THICK**3 / 12, THICK * WIDTH**3 / 12


def leaf(**tables: Any) -> dict[str, Any]:
    """Describe a body at the end of a flat beam along x, thin along z."""
    data = hung()
    data["bodies"]["load"]["origin"] = [LENGTH, 0, 0]
    data["joints"] = {
        "leaf": {
            "type": "beam",
            "a": {"body": "ground", "point": [0, 0, 0]},
            "b": {"body": "load", "point": [0, 0, 0]},
            "normal": [0, 0, 1],
            "youngs_modulus": E,
            "rectangle": {"width": WIDTH, "thickness": THICK},
            "damping_time": 0.02,
        }
    }
    del data["responses"]["force"], data["responses"]["torque"]
    return data | tables


def euler_bernoulli(torsion: float) -> np.ndarray:
    """Return the textbook's 12 x 12 matrix for a beam along x, thin along z; each end: x, y, z, about x, y, z."""
    K, G = np.zeros((12, 12)), E / (2 + 2 * NU)
    for size, i in ((E * AREA / LENGTH, 0), (G * torsion / LENGTH, 3)):
        K[np.ix_([i, i + 6], [i, i + 6])] = size * np.array([[1, -1], [-1, 1]])
    for second, i, j, sign in ((STIFF, 1, 5, 1.0), (SOFT, 2, 4, -1.0)):
        s, far, near = 6 * sign * LENGTH, 4 * LENGTH**2, 2 * LENGTH**2
        block = [[12, s, -12, s], [s, far, -s, near], [-12, -s, 12, -s], [s, near, -s, far]]
        K[np.ix_([i, j, i + 6, j + 6], [i, j, i + 6, j + 6])] = E * second / LENGTH**3 * np.array(block)
    return K


def test_a_beam_has_the_matrix_of_euler_and_bernoulli():
    """The bushing at its middle is all of it: derivatives of the loads on both ends, for both ends moved and turned."""
    data = leaf()
    data["bodies"]["foot"] = {"mass": 1.0, "inertia": [1, 1, 1]}
    data["joints"]["leaf"]["a"]["body"] = "foot"
    arrays = assemble(made(data))
    model, ends = arrays.model, arrays.state.x[:2].copy()
    first = int(np.argmin(ends[:, 0]))
    order = np.r_[6 * first : 6 * first + 6, 6 - 6 * first : 12 - 6 * first]

    def loads(w):
        for body in range(2):
            place(
                arrays,
                body,
                ends[body] + w[6 * body : 6 * body + 3],
                Rotation.from_rotvec(w[6 * body + 3 : 6 * body + 6]),
            )
        work = arrays.work
        apply_loads(model.bodies, model.loads, model.time_laws, arrays.state, 0, 0.0, work.wrench, work.vectors)
        return work.wrench[:2].ravel().copy()

    step = 1e-7
    found = -np.array([(loads(step * e) - loads(-step * e)) / (2 * step) for e in np.eye(12)]).T
    torsion = WIDTH * THICK**3 * (1 / 3 - 0.21 * THICK / WIDTH * (1 - THICK**4 / (12 * WIDTH**4)))
    expected = euler_bernoulli(torsion)
    assert found[np.ix_(order, order)] == pytest.approx(expected, rel=1e-6, abs=1e-7 * np.abs(expected).max())


@each(("way", "second"), [(2, SOFT), (1, STIFF)])
def test_a_cantilever_bends_by_its_closed_form(way, second):
    """F L^3 / 3 E I at its tip, F L^2 / 2 E I its slope, F L / 2 the moment at its middle."""
    force = np.zeros(3)
    force[way] = 1e-3 * 3 * E * second / LENGTH**2  # a thousandth of the length
    data = leaf(forces={"tip": {"body": "load", "force": force.tolist()}})
    data["responses"]["moment"] = {"type": "joint_torque", "joint": "leaf"}
    data["simulation"] |= {"step": 5e-3, "rest": {"window": 0.1, "drift": 1e-9}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["xyz"[way]] == pytest.approx(1e-3 * LENGTH, rel=1e-4)
    slope = run.responses["turn_y" if way == 2 else "turn_z"]
    assert abs(slope) == pytest.approx(force[way] * LENGTH**2 / (2 * E * second), rel=1e-4)
    assert run.responses["moment"] == pytest.approx(force[way] * LENGTH / 2, rel=1e-4)


def test_a_tip_mass_swings_at_its_natural_frequency():
    """Half a period of sqrt(3 E I / m L^3) of a mass that hardly turns the tip: its radius of gyration is small."""
    data = leaf()
    data["bodies"]["load"] |= {"inertia": [1e-6] * 3, "velocity": [0, 0, 1e-3]}
    data["joints"]["leaf"]["damping_time"] = 0.0
    omega = np.sqrt(3 * E * SOFT / MASS / LENGTH**3)
    data["phases"] = [{"name": "run", "duration": 0.5 * float(np.pi / omega)}]
    data["simulation"]["step"] = float(np.pi / omega) / 400
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(1e-3 / omega, rel=1e-3)
    assert run.certificate.created_energy < 1e-12


def test_two_beams_in_a_row_are_one_of_both_lengths():
    """With a body of no weight between them: the tip bends eight times as far."""
    force = 1e-3 * 3 * E * SOFT / LENGTH**2
    data = leaf(forces={"tip": {"body": "load", "force": [0, 0, 0.25 * force]}})
    data["bodies"]["middle"] = {"mass": 0.5, "inertia": [0.01] * 3, "origin": [LENGTH, 0, 0]}
    data["bodies"]["load"]["origin"] = [2 * LENGTH, 0, 0]
    one = data["joints"]["leaf"]
    data["joints"]["second"] = one | {"a": {"body": "middle", "point": [0, 0, 0]}}
    one["b"] = {"body": "middle", "point": [0, 0, 0]}
    data["simulation"] |= {"step": 5e-3, "rest": {"window": 0.2, "drift": 1e-9}}
    run = simulate(made(data))
    assert run.status == "ok", run.message
    assert run.responses["z"] == pytest.approx(8 * 0.25e-3 * LENGTH, rel=1e-3)


# Keys and errors.


def test_each_number_has_a_key():
    """A campaign varies them."""
    keys = settable_keys(made(hung(damping=[1.0, 2.0, 3.0])))
    assert {f"joints.mount.{table}.{axis}" for table in ("stiffness", "damping") for axis in "xyz"} <= set(keys)
    changed = set_values(made(hung()), {"joints.mount.stiffness.z": 7.0})
    assert changed.joints["mount"].stiffness == (*ALONG[:2], 7.0)
    beam = set_values(made(leaf()), {"joints.leaf.rectangle.thickness": 2 * THICK})
    assert beam.joints["leaf"].springs(1.0)[0][1] == pytest.approx(8 * made(leaf()).joints["leaf"].springs(1.0)[0][1])


@each(
    ("change", "named"),
    [
        ({"stiffness": [-1.0, 0, 0]}, r"joints\.mount\.stiffness\.x"),
        ({"stiffness": [0, 0, 0], "torsional_stiffness": [0, 0, 0]}, r"joints\.mount\.stiffness"),
        ({"normal": [1.0, 0, 0]}, r"joints\.mount\.normal"),
        ({"damping": [1.0, 1.0]}, r"joints\.mount\.damping"),
        ({"limits": {"lower": 0.0}}, r"joints\.mount\.limits"),
        ({"friction": 0.3}, r"joints\.mount\.friction"),
        ({"restitution": 0.0}, r"joints\.mount\.restitution"),
    ],
)
def test_a_bushing_that_cannot_be_is_refused(change, named):
    with pytest.raises(MechanismError, match=named):
        made(hung(**change))


@each(
    ("change", "named"),
    [
        ({"rectangle": None}, r"joints\.leaf"),
        ({"round": {"diameter": 0.01}}, r"joints\.leaf"),
        ({"poissons_ratio": 0.6}, r"joints\.leaf\.poissons_ratio"),
        ({"b": {"body": "load", "point": [-LENGTH, 0, 0]}}, r"joints\.leaf\.b\.point"),
        ({"normal": [1.0, 0, 0]}, r"joints\.leaf\.normal"),
    ],
)
def test_a_beam_that_cannot_be_is_refused(change, named):
    data = leaf()
    joint = data["joints"]["leaf"] | change
    data["joints"]["leaf"] = {key: value for key, value in joint.items() if value is not None}
    with pytest.raises(MechanismError, match=named):
        assemble(made(data))


def test_what_no_bushing_has_is_refused():
    """The plain scheme computes no stiffness; the torque of another joint is none of a bushing."""
    data = hung()
    data["simulation"]["scheme"] = "moreau_jean"
    with pytest.raises(MechanismError, match=r"joints\.mount\.type"):
        made(data)
    data = hung()
    data["joints"]["mount"] = {key: data["joints"]["mount"][key] for key in ("a", "b")} | {"type": "fixed"}
    with pytest.raises(MechanismError, match=r"responses\.torque\.joint"):
        assemble(made(data))
