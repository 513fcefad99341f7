"""The study on files that imitate the authors': drawn from the numbers of `c60.toml`, whole and as single faces."""

from math import cos, sin

import numpy as np
import pytest
from OCP.BRep import BRep_Builder
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace
from OCP.gp import gp_Ax2, gp_Circ, gp_Dir, gp_Pln, gp_Pnt
from OCP.TopoDS import TopoDS_Compound

from engine import load_mechanism
from engine.cad.archive import packed
from engine.cad.occt.step_assembly import read_assembly
from studies.c60_cad import lines, listed_files, listed_names, start_pose
from tests.engine.cad.hinges import as_splines
from tests.engine.cad.step_files import Drawing, box, cut, cylinder

pytestmark = pytest.mark.slow

WALL = 0.6  # of the tubes that stand for the bodies
PART_FILES = {
    "handle": "CAD/C60/manette.stp",
    "rod": "CAD/C60/biellette.stp",
    "hook": "CAD/C60/crochet.stp",
    "plate": "CAD/C60/platine.stp",
    "moving_contact": "CAD/C60/portcontact/porte_contact.stp",
    "tripping_bar": "CAD/C60/newFC/Tbarassembly.stp",
    "needle": "CAD/C60/J1/Aiguille.stp",
    "case": "CAD/C60/J1/Case_handle_J1_journal_surface.stp",
}


@pytest.fixture(autouse=True)
def in_this_process(tmp_path, monkeypatch):
    """Let OCCT answer here, and keep nothing in the user's cache."""

    def answer(path, content, question, limits):
        return packed(read_assembly(path, **question["assembly"]))

    monkeypatch.setattr("engine.cad.step_reader.ask_occt", answer)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def written(path, *shapes):
    """Write shapes of a body as one product; return the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(whole)
    for shape in shapes:
        builder.Add(whole, shape)
    made = Drawing()
    made.product(path.stem, whole)
    return made.write(path)


def station(mechanism, joint, ring):
    """Return the centre of a ring and the axis, on the bearing and on the journal, each in its body."""
    bearing, journal = (start_pose(mechanism, side.body) for side in joint.sides)
    axis, along = np.array(joint.bearing.axis), np.array(joint.journal.axis)
    centre = np.array(joint.bearing.point) + ring * axis
    at = np.array(joint.journal.point)
    there = (bearing.to_assembly(centre) - journal.translation) @ journal.matrix
    beside = at + (there - at) @ along * along
    return (centre, axis), (beside, along)


def tubes_and_pins(mechanism, radius_of_hole):
    """Return the shapes of each body: a tube round each ring of its bearings, a pin through those of its journals."""
    shapes = {body: [] for body in PART_FILES}
    for name in mechanism.loose_joints():
        joint = mechanism.joints[name]
        for ring, radius in zip(joint.rings, joint.radii, strict=True):
            (centre, axis), (beside, along) = station(mechanism, joint, ring)
            base, hole = centre - 0.25 * axis, radius_of_hole(name, radius)
            tube = cut(cylinder(base, hole + WALL, 0.5, axis), cylinder(base - axis, hole, 2.5, axis))
            shapes[joint.bearing.body].append(tube)
            shapes[joint.journal.body].append(cylinder(beside - 0.4 * along, radius, 0.8, along))
    return shapes


def stop(mechanism, name):
    """Return the half ring and the plane of a stop, each with its body."""
    contact = mechanism.contacts[name]
    arc, plane = (contact.a, contact.b) if contact.a.kind == "arc" else (contact.b, contact.a)
    ring, flat = arc.arc, plane.primitive
    point = flat.point if plane.kind == "plane" else flat.centre
    circle = gp_Circ(gp_Ax2(gp_Pnt(*ring.centre), gp_Dir(*ring.normal), gp_Dir(*ring.middle)), ring.radius)
    edge = BRepBuilderAPI_MakeEdge(circle, -ring.half_angle, ring.half_angle).Edge()
    face = BRepBuilderAPI_MakeFace(gp_Pln(gp_Pnt(*point), gp_Dir(*flat.normal)), -1.0, 1.0, -1.0, 1.0).Face()
    return (arc.body, edge), (plane.body, face)


def table(text, first):
    """Return the cells of the rows of a table by their first cell."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text if line.startswith("|")]
    begin = next(i for i, row in enumerate(rows) if row[0] == first) + 1
    rest = rows[begin:]
    end = next((i for i, row in enumerate(rest) if row[0] in ("joint", "contact")), len(rest))
    return {row[0]: row[1:] for row in rest[:end] if row[0] != "---"}


@pytest.mark.parametrize(
    ("drawn", "clearance", "within"),
    [
        (lambda shape: shape, lambda name: 0.0, 1e-4),
        (lambda shape: shape, lambda name: 0.02 if name in ("J5", "J6") else 0.15, 1e-4),
        (as_splines, lambda name: 0.0, 3e-4),
    ],
    ids=["equal radii", "with play", "splines"],
)
def test_all_joints(tmp_path, drawn, clearance, within):
    """J1 to J7 and S3 and no other, with their radii; the gaps at the start follow from the axes of the files."""
    mechanism = load_mechanism("c60")
    shapes = tubes_and_pins(mechanism, lambda name, radius: radius + clearance(name))
    for body, own in shapes.items():
        written(tmp_path / PART_FILES[body], *map(drawn, own))
    text = [*"\n".join(lines(listed_files(tmp_path))).splitlines()]
    assert not [line for line in text if line.startswith("no joint")]
    joints = table(text, "joint")
    assert list(joints) == [*mechanism.loose_joints()]
    for name, (radii, given, play, bearing, journal, inside, gap, start) in joints.items():
        assert [float(x) for x in radii.split(",")] == pytest.approx([float(x) for x in given.split(",")], abs=within)
        assert float(play) == pytest.approx(clearance(name), abs=2 * within)
        assert max(float(bearing), float(journal)) <= within
        assert inside == "yes"
        assert float(gap) == pytest.approx(float(start), abs=within)


def test_a_pin_that_is_elsewhere(tmp_path):
    """The rod drawn 0.03 mm off: what the table says of J5 and J6 is that."""
    mechanism = load_mechanism("c60")
    shapes = tubes_and_pins(mechanism, lambda name, radius: radius)
    from tests.engine.cad.step_files import moved

    angle = mechanism.bodies["rod"].angle
    for body, own in shapes.items():
        shifted = [moved(shape, x=0.03 * cos(angle), y=-0.03 * sin(angle)) for shape in own] if body == "rod" else own
        written(tmp_path / PART_FILES[body], *shifted)
    joints = table([*"\n".join(lines(listed_files(tmp_path))).splitlines()], "joint")
    for name, row in joints.items():
        assert float(row[4]) == pytest.approx(0.03 if name in ("J5", "J6") else 0.0, abs=1e-4)
        assert (row[6] == row[7]) is (name not in ("J5", "J6"))


@pytest.mark.parametrize("name", ["C1_1", "C1_4", "C3_1", "C4_3"])
def test_stops(tmp_path, name):
    """Half rings and faces in files of their own: the gap at the start is that of `c60.toml`; others are not there."""
    mechanism = load_mechanism("c60")
    edge, face = stop(mechanism, name)
    files = {
        edge[0]: [written(tmp_path / "ring.stp", edge[1], box((50.0, 50.0, 50.0), (1.0, 1.0, 1.0)))],
        face[0]: [written(tmp_path / "plane.stp", face[1])],
    }
    contacts = table([*"\n".join(lines(files)).splitlines()], "contact")
    drawn, given = contacts[name]
    assert float(drawn) == pytest.approx(float(given), abs=1e-4)
    assert contacts["C6_1"][0] == "not in the files"


def test_no_files(tmp_path):
    """A folder without them."""
    assert next(lines(listed_files(tmp_path))).startswith("0 of ")


def test_files_are_listed_once():
    """Each is of one body, and there is the part of each body that moves."""
    listed = listed_names()
    assert all(len(set(names)) == len(names) for names in listed.values())
    assert all(PART_FILES[body] in names for body, names in listed.items())
    assert set(listed) == set(load_mechanism("c60").bodies)
