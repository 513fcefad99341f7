"""Joints with play: the gaps of their faces at poses worked out by hand."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.assembly import assemble
from engine.errors import MechanismError
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.kernels.model import TURN
from engine.mechanism import set_values
from tests.each import each
from tests.engine.assembly.pairs_of_bodies import PLAY, joined
from tests.engine.small import made, small


def gaps(data: dict[str, Any]) -> dict[str, float]:
    """Return the gaps at the start by the contacts' names."""
    assembly = assemble(made(data))
    return dict(zip(assembly.contact_names, assembly.state.gap.tolist(), strict=True))


def on_ground(joint: dict[str, Any], **body: Any) -> dict[str, Any]:
    """Describe a moving body ``part`` in a joint with the ground; overlap at the start is let pass."""
    return small(
        bodies={"ground": {"fixed": True}, "part": {"mass": 1.0, "inertia": [1, 1, 1], **body}},
        joints={"J": {"friction": 0.1, **joint}},
        simulation={"penetration": 1e3},
    )


def wheel(flanges: dict[str, Any] | None = None, **body: Any) -> dict[str, Any]:
    """Describe a wheel on the ground's pin along z, 2 thick, play 0.1 radially and 0.3 axially."""
    axis = {"point": [0, 0, 0], "axis": [0, 0, 1]}
    joint = {
        "type": "clearance_revolute",
        "bearing": {"body": "part", **axis},
        "journal": {"body": "ground", **axis, "radius": 0.5},
        "rings": [-1.0, 1.0],
        "radial_clearance": 0.1,
        "flanges": {"radius": 2.0, **(flanges or {})},
        "axial_clearance": 0.3,
    }
    return on_ground(joint, **body)


START = [f"J.flange_start{i}" for i in (1, 2, 3)]
END = [f"J.flange_end{i}" for i in (1, 2, 3)]


def test_flanges_of_a_wheel_moved_along_its_pin():
    """Moved by 0.2 along the axis, the play is 0.5 at the start flange and 0.1 at the end flange."""
    found = gaps(wheel(origin=[0.03, 0.04, 0.2]))
    assert list(found) == ["J.ring1", "J.ring2", *START, *END]
    assert [found[name] for name in START] == pytest.approx([0.5] * 3, abs=1e-15)
    assert [found[name] for name in END] == pytest.approx([0.1] * 3, abs=1e-15)
    assert [found["J.ring1"], found["J.ring2"]] == pytest.approx([0.05] * 2, abs=1e-15)


@pytest.mark.parametrize("phase", [0.0, 0.4])
def test_flanges_of_a_tilted_wheel(phase):
    """Tilted about x by a, a point at angle t on the end face is at z = cos a + 2 sin t sin a."""
    tilt, found = 0.1, gaps(wheel({"phase": phase}, axis=[1, 0, 0], angle=0.1))
    for i in range(3):
        lift = 2 * np.sin(phase + i * 2 * np.pi / 3) * np.sin(tilt)
        assert found[END[i]] == pytest.approx(0.3 + 1 - (np.cos(tilt) + lift), abs=1e-14)
        assert found[START[i]] == pytest.approx(0.3 + 1 + (lift - np.cos(tilt)), abs=1e-14)


def test_flange_points_lie_on_their_circle_and_push_apart():
    """The contact points at the three corners of a triangle; the wheel is pushed off the flange."""
    assembly = assemble(made(wheel({"phase": np.pi / 2, "sides": "end", "ends": [-1.5, 2.5]})))
    assert list(assembly.contact_names[2:]) == END
    state, work = assembly.state, assembly.work
    find_contacts(assembly.model.contacts, state.x, state.R, work.gap, work.sites.point, work.sites.frame)
    half = np.sqrt(3)
    np.testing.assert_allclose(work.sites.point[2:], [[0, 2, 2.5], [-half, -1, 2.5], [half, -1, 2.5]], atol=1e-14)
    np.testing.assert_allclose(work.sites.frame[2:, 0], [[0, 0, -1]] * 3, atol=1e-15)
    assert assembly.model.contacts.a[2:].tolist() == [0, 0, 0], "the bearing is the body pushed along the normal"


@pytest.mark.parametrize(("sides", "there"), [("both", START + END), ("start", START), ("end", END)])
def test_each_flange_may_be_left_out(sides, there):
    """Only the flanges asked for; a journal that points the other way is the same journal."""
    data = wheel({"sides": sides}, origin=[0, 0, 0.2])
    found = gaps(data)
    assert [name for name in found if "flange" in name] == there
    data["joints"]["J"]["journal"]["axis"] = [0, 0, -1]
    assert gaps(data) == pytest.approx(found, abs=1e-15)


def test_flanges_without_rings():
    """Two faces alone: a plane joint with play, its end faces given."""
    data = wheel({"ends": [-1.0, 1.0]}, origin=[7.0, 0, 0.2])
    for key in ("rings", "radial_clearance"):
        del data["joints"]["J"][key]
    found = gaps(data)
    assert list(found) == START + END
    assert [found[name] for name in END] == pytest.approx([0.1] * 3, abs=1e-15)


def test_a_clearance_is_a_number_added_to_the_gaps():
    """Setting axial and radial clearance changes clearances alone, no geometry."""
    mechanism = made(wheel())
    before, after = (
        assemble(m).model.contacts
        for m in (mechanism, set_values(mechanism, {"joints.J.axial_clearance": 0.7, "J": 0.2}))
    )
    assert after.clearance.tolist() == [0.2, 0.2, *[0.7] * 6]
    np.testing.assert_array_equal(after.geometry_a, before.geometry_a)
    np.testing.assert_array_equal(after.geometry_b, before.geometry_b)


def sliding(joint: dict[str, Any], **body: Any) -> dict[str, Any]:
    """Describe a slider in the ground's guide along x, its height along z."""
    way = {"point": [0, 0, 0], "axis": [2, 0, 0], "normal": [0, 0, 3]}
    joint = {
        "type": "clearance_prismatic",
        "guide": {"body": "ground", **way},
        "slider": {"body": "part", **way},
    } | joint
    return on_ground(joint, **body)


BLOCK = {"half_length": 4.0, "half_height": 1.0, "half_width": 2.0}


def test_block_in_a_slot():
    """Moved up by 0.1 and to the right (-y) by 0.05: the play left at each face; along the slot it is free."""
    data = sliding({"block": BLOCK, "clearance": 0.3, "width_clearance": 0.2}, origin=[9.0, -0.05, 0.1])
    found = gaps(data)
    assert len(found) == 16
    for face, gap in {"bottom": 0.4, "top": 0.2, "left": 0.25, "right": 0.15}.items():
        assert [found[f"J.{face}{i}"] for i in (1, 2, 3, 4)] == pytest.approx([gap] * 4, abs=1e-14)


def test_block_tilted_in_a_slot():
    """Pitched by a about y, the corners at the top are at z = cos a -+ 4 sin a: two close in, two move off."""
    pitch = 0.02
    found = gaps(sliding({"block": BLOCK, "clearance": 0.3}, axis=[0, 1, 0], angle=pitch))
    assert len(found) == 8, "the pair of faces without a clearance is left out"
    top = sorted(found[f"J.top{i}"] for i in (1, 2, 3, 4))
    near, far = (1.3 - np.cos(pitch) + side * 4 * np.sin(pitch) for side in (-1, 1))
    assert top == pytest.approx([near, near, far, far], abs=1e-14)


def test_block_corners_are_eight_points():
    """Each of the eight corners touches one face of the height and one of the width."""
    contacts = assemble(made(sliding({"block": BLOCK, "clearance": 0.3, "width_clearance": 0.2}))).model.contacts
    corners = np.array([(x, y, z) for x in (-4, 4) for y in (-2, 2) for z in (-1, 1)], float)
    for faces in (contacts.geometry_a[:8, :3], contacts.geometry_a[8:, :3]):
        assert sorted(map(tuple, faces.round(12).tolist())) == sorted(map(tuple, corners.tolist()))


@pytest.mark.parametrize("turned", [("axis",), ("normal",), ("axis", "normal")])
def test_a_block_may_be_described_the_other_way_round(turned):
    """A slider's axis or normal reversed is the same box: the gaps are the same, corner order aside."""
    data = sliding({"block": BLOCK, "clearance": 0.3, "width_clearance": 0.2}, axis=[1, 2, 3], angle=0.03)
    before = gaps(data)
    for key in turned:
        data["joints"]["J"]["slider"][key] = [-x for x in data["joints"]["J"]["slider"][key]]
    assert gaps(data) == pytest.approx(before, abs=1e-14)


@pytest.mark.parametrize("turning", ["held", "free"])
def test_shaft_in_a_sleeve(turning):
    """Two rings about the shaft; rotation about the axis is held by one row, or free."""
    shaft = {"radius": 0.5, "rings": [-2.0, 3.0], "turning": turning}
    tilt = 0.01
    data = sliding({"shaft": shaft, "clearance": 0.1}, origin=[5.0, 0.0, 0.03], axis=[0, 1, 0], angle=tilt)
    data["joints"]["J"]["slider"].pop("normal")
    assembly = assemble(made(data))
    off = [abs((s - 5.0) * np.sin(tilt) - 0.03 * np.cos(tilt)) for s in (-2, 3)]
    assert assembly.contact_names == ("J.ring1", "J.ring2")
    assert assembly.state.gap == pytest.approx([0.1 - e for e in off], abs=1e-14)
    ties = assembly.model.bilateral
    assert ties.kind.tolist() == ([TURN] if turning == "held" else [])
    if turning == "held":
        np.testing.assert_allclose(ties.geometry[0, 3:6], [1, 0, 0], atol=1e-15)


def test_cylindrical_joint_with_play_is_rings_alone():
    """Free along the axis: however far it has slid, the rings' gaps are the same."""
    data = wheel(origin=[0.03, 0.04, 50.0])
    data["joints"]["J"]["type"] = "clearance_cylindrical"
    for key in ("flanges", "axial_clearance"):
        del data["joints"]["J"][key]
    assert gaps(data) == pytest.approx({"J.ring1": 0.05, "J.ring2": 0.05}, abs=1e-15)


FACES = {"revolute": 8, "cylindrical": 2, "prismatic": 16, "spherical": 1}


@pytest.mark.parametrize("kind", FACES)
def test_one_word_makes_a_joint_ideal_or_loose(kind):
    """The same file with one word changed, both ways: contacts with the clearances in them, or rows."""
    for loose in (False, True):
        data = joined(kind, np.random.default_rng(21), loose=loose)
        mechanism = made(data)
        assembly = assemble(mechanism)
        rows, faces = len(assembly.model.bilateral.kind), len(assembly.contact_names)
        assert (rows > 0, faces) == ((False, FACES[kind]) if loose else (True, 0))
        if loose:
            joint = mechanism.joints["J"]
            play = [getattr(joint, joint.face_clearance(face.split(".")[1])) for face in assembly.contact_names]
            assert assembly.state.gap.tolist() == pytest.approx(play, abs=1e-14)


@each("key", ["material", "friction", *PLAY["revolute"], "journal.radius"])
def test_an_ideal_joint_needs_no_key_of_its_loose_form(key):
    """Any one of them left out is no fault of an ideal joint."""
    data = joined("revolute", np.random.default_rng(22))
    joint = data["joints"]["J"]
    (joint["journal"] if "." in key else joint).pop(key.split(".")[-1], None)
    assert len(assemble(made(data)).model.bilateral.kind) == 5


def test_overlap_of_a_flange_names_the_axial_clearance():
    """The wheel 0.4 along its pin with 0.3 of play: one line, with what would be enough."""
    data = wheel(origin=[0, 0, 0.4])
    data["simulation"] |= {"penetration": 1e-9, "assembly_travel": 0.0}
    with pytest.raises(MechanismError) as caught:
        assemble(made(data))
    first, *lines = str(caught.value).split("\n")
    assert first == "small: parts overlap at the start pose"
    assert len(lines) == 1
    assert lines[0].startswith("  joints.J.axial_clearance = 0.3 m: flange_end1 is 0.4 m off its centred place")
    assert lines[0].endswith("allowed: at least 0.4 m, or move the bodies")


def test_overlap_says_what_the_worst_face_needs():
    """A tilted wheel: its rings' fault and its flanges' fault, each with the clearance that would do for all."""
    data = wheel(axis=[1, 0, 0], angle=0.3)
    data["simulation"] |= {"penetration": 1e-9, "assembly_travel": 0.0}
    needed = {name.split(".")[1][:-1]: 0.0 for name in gaps(wheel())}
    clearance = {"ring": 0.1, "flange_start": 0.3, "flange_end": 0.3}
    for name, gap in gaps(wheel(axis=[1, 0, 0], angle=0.3)).items():
        face = name.split(".")[1][:-1]
        needed[face] = max(needed[face], clearance[face] - gap)
    with pytest.raises(MechanismError) as caught:
        assemble(made(data))
    lines = str(caught.value).split("\n")[1:]
    assert [line.split(" = ")[0] for line in lines] == ["  joints.J.radial_clearance", "  joints.J.axial_clearance"]
    for line, face in zip(lines, (["ring"], ["flange_start", "flange_end"]), strict=True):
        assert f"at least {max(needed[f] for f in face):.6g} m" in line


def test_ball_in_a_socket():
    """The play less the distance of the centres; the push is towards the socket's centre, on the ball's surface."""
    joint = {
        "type": "clearance_spherical",
        "socket": {"body": "ground", "point": [1, 1, 1]},
        "ball": {"body": "part", "point": [0, 0, 1], "radius": 2.0},
        "radial_clearance": 0.3,
    }
    assembly = assemble(made(on_ground(joint, origin=[1.0, 1.12, -0.16], axis=[0, 0, 1], angle=0.7)))
    state, work = assembly.state, assembly.work
    assert assembly.contact_names == ("J.ball",)
    assert state.gap[0] == pytest.approx(0.3 - 0.2, abs=1e-14)
    np.testing.assert_allclose(work.sites.frame[0, 0], [0, -0.6, 0.8], atol=1e-14)
    np.testing.assert_allclose(work.sites.point[0], [1, 1 + 2 * 0.6, 1 - 2 * 0.8], atol=1e-13)


def test_rings_do_not_depend_on_where_the_mechanism_stands():
    """A loose joint between two moving bodies, all of it turned: the same gaps."""
    data = joined("revolute", np.random.default_rng(23), loose=True)
    before = gaps(data)
    turn = Rotation.from_rotvec([0.3, -1.0, 0.4])
    for body in data["bodies"].values():
        axis = np.asarray(body["axis"])
        own = Rotation.from_rotvec(body["angle"] * axis / np.linalg.norm(axis))
        vector = (turn * own).as_rotvec()
        body["angle"] = float(np.linalg.norm(vector))
        body["axis"] = (vector / body["angle"]).tolist()
        body["origin"] = turn.apply(body["origin"]).tolist()
    assert gaps(data) == pytest.approx(before, abs=1e-13)
