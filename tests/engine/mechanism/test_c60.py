"""The shipped C-60 against the published numbers, by a geometry of its own (numpy, none of the kernels)."""

import numpy as np
import pytest

from engine.mechanism import load_mechanism, set_values
from engine.mechanism.contacts import Contact, Side
from tests.each import each

C60 = load_mechanism("c60")


def rotation(axis, angle):
    """Return the rotation matrix by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def world(body: str, point):
    """Return the world position of a point (3,), or points (3, n) as (n, 3), of a body at the start."""
    b = C60.bodies[body]
    return (rotation(b.axis, b.angle) @ np.array(point)).T + b.origin


def turned(body: str, vector):
    """Return the world components of a direction of a body at the start."""
    b = C60.bodies[body]
    return rotation(b.axis, b.angle) @ np.array(vector)


def arc_points(side: Side):
    """Return a fine sampling of an arc, in the world, shape (n, 3)."""
    arc = side.arc
    assert arc is not None
    middle, across = np.array(arc.middle), np.cross(arc.normal, arc.middle)
    angle = np.linspace(-arc.half_angle, arc.half_angle, 20001)[:, None]
    points = arc.centre + arc.radius * (np.cos(angle) * middle + np.sin(angle) * across)
    return world(side.body, points.T)


def to_axis(points, at, along):
    """Return the distances of points, shape (n, 3), to a line."""
    w = np.atleast_2d(points) - at
    return np.linalg.norm(w - np.outer(w @ along, along), axis=1)


def to_plate(points, side: Side):
    """Return the distances of points outside a rectangular plate, shape (n, 3)."""
    face = side.rectangle
    assert face is not None
    along = np.array(face.along)
    axes = [turned(side.body, v) for v in (along, np.cross(face.normal, along), face.normal)]
    x, y, z = ((points - world(side.body, face.centre)) @ axis for axis in axes)
    beside = [abs(x) - face.half_lengths[0], abs(y) - face.half_lengths[1], np.maximum(z, -face.depth - z)]
    return np.linalg.norm(np.maximum(beside, 0), axis=0)


def gap(contact: Contact) -> float:
    """Return the signed gap at the start, minus the skin."""
    a, b = contact.sides
    if contact.kind == "arc-rectangle":
        return float(to_plate(arc_points(a), b).min()) - contact.offset
    if contact.kind == "arc-cylinder":
        at, along = world(b.body, b.cylinder.point), turned(b.body, b.cylinder.axis)
        return float(to_axis(arc_points(a), at, along).min()) - b.cylinder.radius - contact.offset
    at, normal = world(b.body, b.plane.point), turned(b.body, b.plane.normal)
    if contact.kind == "point-plane":
        distance = (world(a.body, a.point) - at) @ normal
    elif contact.kind == "arc-plane":
        distance = ((arc_points(a) - at) @ normal).min()
    else:
        distance = (world(a.body, a.cylinder.point) - at) @ normal - a.cylinder.radius
    return float(distance) - contact.offset


# "gap ON" of the public model, measured there by the CAD kernel between bounded patches
PUBLISHED = {
    "C1_1": 0.023029,
    "C1_2": 0.002561,
    "C1_3": 0.003843,
    "C1_4": 0.023894,
    "C2_1": 8.335986,
    "C2_2": 8.891740,
    "C2_3": 8.797184,
    "C2_4": 9.844171,
    "C3_1": 3.858436,
    "C3_2": 3.831985,
    "C3_3": 4.724650,
    "C3_4": 4.114545,
    "C4_1": 0.007111,
    "C4_2": 0.007111,
    "C4_3": 0.017294,
    "C4_4": 0.017294,
    "C5_1": 0.019465,
    "C5_2": 0.019465,
    "C6_1": 1.146068,
    "C6_2": 1.146068,
    "C6_3": 1.037034,
    "C6_4": 1.037034,
    "C7": 0.038603,
    "S1_1": 0.11,
    "S2_1": 0.4,
    "S4_1": 0.0,
    "Sx_1": 0.24,
    "S5_1": 0.0,
    "S12_1": 0.3,
    "S6_1": 0.4,
    "S11_1": 0.1,
    "S8_1": 0.0,
    "S7_1": 0.0,
}


@each("name", PUBLISHED)
def test_gap_at_the_start_is_the_published_one(name):
    assert gap(C60.contacts[name]) == pytest.approx(PUBLISHED[name], abs=1e-4)


def test_latch_faces_turn_about_the_hooks_edge():
    """By 12 degrees: the faces turn rigidly in hook and bar, the bar's edge stays in its top, and the gaps stay.

    The gaps at the hook's edge shrink by its cosine at most; only the nose (C4_5, C4_6) is farther from the edge.
    """
    angle = np.radians(12)
    moved = set_values(C60, {"parameters.latch_angle": angle}).contacts
    back = rotation((0, 0, 1), -angle)
    for i in range(1, 7):
        name, pivot = f"C4_{i}", (-5.4829, -0.9804, 1.0) if i in (3, 4) else (-0.206, 7.0, 1.0)
        face, shipped = moved[name].b.rectangle, C60.contacts[name].b.rectangle
        assert face.centre == pytest.approx(pivot + back @ np.subtract(shipped.centre, pivot), abs=1e-12)
        assert face.normal == pytest.approx(back @ shipped.normal, abs=1e-12)
        assert face.along == pytest.approx(back @ shipped.along, abs=1e-12)
        assert gap(moved[name]) == pytest.approx(gap(C60.contacts[name]), abs=2e-3 if i < 5 else 2e-2)
    top, edge = moved["C4_1"].b.rectangle, moved["C4_3"].a.arc
    summit = np.add(edge.centre, [0, edge.radius, 0])
    assert np.subtract(summit, top.centre)[:2] @ top.normal[:2] == pytest.approx(0.05, abs=1e-12)


def test_what_is_ours_is_far_away_in_on():
    """Places that no public file has: the nose beside the half rings of the latch, the stops of rod and bar."""
    found = {name: gap(C60.contacts[name]) for name in ("C4_5", "C4_6", "S9_1", "S9_2", "B_1")}
    expected = {"C4_5": 0.055, "C4_6": 0.055, "S9_1": 1.44, "S9_2": 1.65, "B_1": 4.37}
    assert found == pytest.approx(expected, abs=5e-3)


def test_all_points_of_a_stop_start_at_one_gap():
    """Three points on a plane parallel to their face, on a circle of 120 degrees where they are ours."""
    stops = {name.rpartition("_")[0] for name in C60.contacts if name[0] == "S" and name[:2] != "S9"}
    assert stops == {"S1", "S2", "S4", "Sx", "S5", "S12", "S6", "S11", "S8", "S7"}
    for stop in stops:
        contacts = [C60.contacts[f"{stop}_{i}"] for i in (1, 2, 3)]
        np.testing.assert_allclose([gap(c) for c in contacts], gap(contacts[0]), atol=1e-9)
        points = np.array([c.sides[0].point for c in contacts])
        first, second = points[1] - points[0], points[2] - points[0]
        assert np.linalg.norm(np.cross(first, second)) > 1, "three points that carry tilt"
        if stop != "S6":
            np.testing.assert_allclose(points[:, :2].sum(axis=0), 0, atol=1e-5)


def axial_gaps(mechanism):
    """Return the first gap of each stop along z: all parts turn about z, so heights add up."""

    def height(side):
        return mechanism.bodies[side.body].origin[2] + (side.point or side.plane.point)[2]

    found = {}
    for name, contact in mechanism.contacts.items():
        if name[0] == "S" and name.endswith("_1") and name != "S9_1":
            a, b = contact.sides
            found[name[:-2]] = (height(a) - height(b)) * b.plane.normal[2]
    return found


def test_preset_centred_divides_the_drawn_play():
    """Equal gaps on both sides of each part, and between the same two faces as much play as before."""
    drawn, centred = axial_gaps(C60), axial_gaps(set_values(C60, C60.preset("centred")))
    assert [centred[name] for name in ("S7", "S8", "S11")] == pytest.approx([0.1 / 3] * 3)
    for below, above in (("S4", "Sx"), ("S5", "S12"), ("S1", "S2")):
        assert centred[below] == pytest.approx(centred[above])
    for stops in (("S7", "S8", "S11"), ("S7", "S8", "S4", "Sx"), ("S7", "S8", "S5", "S12"), ("S1", "S2")):
        assert sum(centred[name] for name in stops) == pytest.approx(sum(drawn[name] for name in stops))


def test_needle_ends_have_their_play():
    assert gap(C60.contacts["N_1"]) == pytest.approx(0.1, abs=1e-9)
    assert gap(C60.contacts["N_2"]) == pytest.approx(0.1, abs=1e-9)


def test_nothing_overlaps_at_the_start():
    assert min(gap(contact) for contact in C60.contacts.values()) > -1e-9


# joint: (ring heights in the world, eccentricity at the start), as published
RINGS = {
    "J1": ((1.003, 10.097), 0.0),
    "J2": ((4.2075, 9.6925), 0.0),
    "J3": ((7.6025, 10.4975), 0.0060),
    "J4": ((7.303, 11.197), 0.0071),
    "J5": ((4.903, 8.857), 0.0093),
    "J6": ((7.6025, 8.64717), 0.0),
    "J7": ((0.505, 3.795), 0.0),
    "S3": ((-0.49, 10.71), 0.0),
}


@each("name", RINGS)
def test_rings_lie_where_published(name):
    joint, (heights, eccentricity) = C60.joints[name], RINGS[name]
    bearing, journal = joint.bearing, joint.journal
    stations = [np.array(bearing.point) + s * np.array(bearing.axis) for s in joint.rings]
    centres = np.array([world(bearing.body, p) for p in stations])
    np.testing.assert_allclose(centres[:, 2], heights, atol=1e-4)
    along = turned(journal.body, journal.axis)
    off = to_axis(centres, world(journal.body, journal.point), along)
    np.testing.assert_allclose(off, eccentricity, atol=1e-4)
    assert abs(abs(along @ turned(bearing.body, bearing.axis)) - 1) < 1e-12, "axes are parallel"


def test_every_clearance_of_the_paper_can_start():
    """0.01 mm is the paper's smallest clearance: no journal starts farther off its bearing's axis."""
    assert max(eccentricity for _, eccentricity in RINGS.values()) < 0.01


def measured(name: str) -> float:
    """Return a position response at the start."""
    r = C60.responses[name]
    end = world(r.to.body, r.to.point)
    if r.from_.axis is not None:
        at, along = world(r.from_.body, r.from_.axis.point), turned(r.from_.body, r.from_.axis.axis)
        start = at + (end - at) @ along * along
    else:
        start = world(r.from_.body, r.from_.point)
    way = turned(r.direction.body, r.direction.vector) if r.direction.body else np.array(r.direction.vector)
    return float(way @ (end - start)) + r.offset


@pytest.mark.parametrize(
    ("name", "published"),
    [
        ("FC-2", 10.590326 + 0.005),  # the public surface is a bar of radius 0.005 around the pin's axis
        ("FC-3", 2.972136 + 0.005),
        ("FC-4", 10.762815),
        ("FC-5", 2.43265),
        ("FC-6", 0.389133),
        ("latch_overlap", 0.4576),
    ],
)
def test_functional_conditions_at_the_start_are_the_published_ones(name, published):
    assert measured(name) == pytest.approx(published, abs=1e-4)


def test_spring_forces_at_the_start_are_the_published_ones():
    a2 = C60.springs["A2"]
    length = np.linalg.norm(world(a2.b.body, a2.b.point) - world(a2.a.body, a2.a.point))
    assert length == pytest.approx(11.297, abs=1e-3)
    assert a2.stiffness * (a2.free_length - length) == pytest.approx(8.286, abs=1e-3)
    couples = {}
    for name in ("A3", "handle_spring"):
        s = C60.springs[name]
        phi = C60.bodies[s.b].angle - C60.bodies[s.a].angle  # both turn about z
        couples[name] = -s.stiffness * (phi - s.free_angle + s.preload)
    assert couples["A3"] == pytest.approx(-265.76, abs=1e-2), "clockwise on the moving contact: closes C7"
    assert couples["handle_spring"] == pytest.approx(10.1353, abs=1e-3), "opens the handle"


def test_contact_force_balances_the_spring_like_the_published_estimate():
    """Without friction the spring's couple over C7's lever about the needle gives about 13.2 to 13.4 N."""
    side = C60.contacts["C7"].sides[0]
    lever = -(world(side.body, side.cylinder.point)[1])
    assert lever == pytest.approx(19.854, abs=1e-3)
    assert 265.76 / lever == pytest.approx(13.39, abs=0.01)


def test_materials_are_those_of_the_paper():
    laws = {name: C60.contact_law(joint) for name, joint in C60.joints.items()}
    plastic = {"J1", "J3", "J4"}
    assert laws == {name: (0.3 if name in plastic else 0.1, 0.0) for name in laws}
    frictions = {name: C60.contact_law(contact)[0] for name, contact in C60.contacts.items()}
    metal = {"C7", "N_1", "N_2", "S6_1", "S6_2", "S6_3", "S9_1", "S9_2"}
    assert frictions == {name: 0.1 if name in metal else 0.3 for name in frictions}


def test_what_is_in_it():
    moving = [name for name, body in C60.bodies.items() if not body.fixed]
    assert moving == ["handle", "rod", "hook", "plate", "moving_contact", "tripping_bar", "needle"]
    masses = [1.3, 0.5, 0.09, 1.35, 2.5, 0.77, 0.39]
    assert [C60.bodies[name].mass for name in moving] == masses
    assert [phase.name for phase in C60.phases] == ["hold", "free"]
    assert C60.torques["latch_hold"].phases == ("hold",)
    assert [str(condition) for condition in C60.validity] == ["latch_overlap > 0", "FC-1 > 0"]
    lengths = [f"FC-{i}" for i in range(2, 7)]
    assert list(C60.responses) == ["FC-1", "FC-1_low", "FC-1_high", *lengths, "latch_overlap", "latched"]
