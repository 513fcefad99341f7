"""Files that name geometry of a CAD file become plain mechanisms, or every fault is named."""

import math
import os
import subprocess
import sys
from copy import deepcopy

import numpy as np
import pytest
import tomli_w

from engine import MechanismError, load_mechanism, load_mechanism_text
from engine.mechanism import mechanism_from
from tests.each import each
from tests.engine.mechanism.geometry.latch_file import LATCH, latch_file

pytestmark = pytest.mark.processes


@pytest.fixture
def load(tmp_path):
    """Return a function that loads a mechanism file of these tables."""

    def loaded(data):
        path = tmp_path / "latch.toml"
        path.write_text(tomli_w.dumps(data))
        return load_mechanism(path)

    return loaded


def faults(load, data):
    """Return what is said of a file, by its keys."""
    with pytest.raises(MechanismError) as error:
        load(data)
    return {fault.key: fault for fault in error.value.faults}


def changed(*path_and_value, data=None):
    """Return the latch with one key changed; without it if the value is None."""
    *path, last, value = path_and_value
    tables = deepcopy(data or latch_file())
    node = tables
    for key in path:
        node = node[key]
    if value is None:
        del node[last]
    else:
        node[last] = value
    return tables


def test_joints_as_drawn(load):
    """Points, axes, radii, rings and clearances are those that the latch was drawn with."""
    mechanism = load(latch_file())
    drawn = {"foot": (3.0, 0.05, 4.6), "heel": (3.0, 0.06, 5.0), "knee": (2.5, 0.04, 5.0), "toe": (2.5, 0.05, 5.0)}
    for name, (radius, clearance, length) in drawn.items():
        joint = mechanism.joints[name]
        assert joint.journal.radius == pytest.approx(radius, abs=1e-9)
        assert joint.radial_clearance == pytest.approx(clearance, abs=1e-9)
        assert joint.rings == pytest.approx((-length / 2, length / 2), abs=1e-9)
        np.testing.assert_allclose(joint.bearing.axis, (0, 0, 1), atol=1e-12)
    toe = mechanism.joints["toe"]
    np.testing.assert_allclose(toe.bearing.point, (math.hypot(44, 6), 0, 2.5), atol=1e-9)
    np.testing.assert_allclose(toe.journal.point, (math.hypot(6, 30), 0, 7.55), atol=1e-9)


def test_bodies_as_drawn(load):
    """The coupler is a bar with round ends and two holes: volume and moments from closed forms."""
    body = load(latch_file()).bodies["coupler"]
    length, w, t, rho = math.hypot(44, 6), 14.0, 5.0, 2.7e-3
    half = math.pi * (w / 2) ** 2 / 2  # the area of the round end
    centroid = 4 * (w / 2) / (3 * math.pi)
    area = length * w + 2 * half - math.pi * (2.54**2 + 2.55**2)
    moment = length * w * length / 2 - half * centroid + half * (length + centroid) - math.pi * 2.55**2 * length
    assert body.mass == pytest.approx(area * t * rho, rel=1e-8)
    np.testing.assert_allclose(body.center_of_mass, (moment / area, 0, t / 2), atol=1e-8)
    np.testing.assert_allclose(body.origin, (0, 24, 5.1), atol=1e-12)
    assert body.angle == pytest.approx(math.atan2(6, 44), abs=1e-12)


def test_outlines_as_drawn(load):
    """The coupler is drawn as the bar with round ends that it is; an outline of the file stays."""
    corners = np.array(load(latch_file()).bodies["coupler"].outline)
    length = math.hypot(44, 6)
    along = np.clip(corners[:, 0], 0, length)
    np.testing.assert_allclose(np.hypot(corners[:, 0] - along, corners[:, 1]), 7.0, atol=0.15)
    assert np.ptp(corners[:, 0]) == pytest.approx(length + 14, abs=0.2)
    own = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    kept = load(changed("bodies", "coupler", "outline", own)).bodies["coupler"].outline
    assert [list(corner) for corner in kept] == own


def test_the_stop(load):
    """A flat face becomes a plane."""
    plane = load(latch_file()).contacts["stop"].b.plane
    np.testing.assert_allclose(plane.normal, (-1, 0, 0), atol=1e-12)
    assert plane.point[0] == pytest.approx(7.8, abs=1e-12)


def test_an_arc_and_a_hole_of_contacts(load):
    """A circular edge becomes an arc, a hole a bore with its ends."""
    data = changed("contacts", "stop", "a", {"body": "crank", "arc": {"edge": {"near": [24.0 + 4.5, 0.0, 10.1]}}})
    arc = load(data).contacts["stop"].a.arc
    np.testing.assert_allclose(arc.centre, (24, 0, 10.1), atol=1e-9)
    assert (arc.radius, arc.half_angle) == (pytest.approx(4.5, abs=1e-9), math.pi)
    data["contacts"]["stop"]["b"] = {"body": "coupler", "hole": {"radius": 2.54, "near": [0.0, 0.0, 2.5]}}
    bore = load(data).contacts["stop"].b.bore
    assert (bore.radius, bore.half_length) == (pytest.approx(2.54, abs=1e-9), pytest.approx(2.5, abs=1e-9))


def test_in_si(load):
    """The same file in metres and kilograms is the same mechanism."""
    data = latch_file()
    data["units"] = "SI"
    for joint in data["joints"].values():
        for side, kind in (("bearing", "hole"), ("journal", "pin")):
            selector = joint[side][kind]
            joint[side][kind] = {"radius": selector["radius"] / 1e3, "near": [x / 1e3 for x in selector["near"]]}
    data["contacts"]["stop"]["a"]["point"] = [0.014, -0.007, 0.0025]
    data["contacts"]["stop"]["b"]["plane"]["near"] = [0.0078, 0.014, 0.0025]
    metres, millimetres = load(data), load(latch_file())
    for name in ("crank", "coupler"):
        assert metres.bodies[name].mass == pytest.approx(millimetres.bodies[name].mass / 1e3, rel=1e-12)
        small = np.array(metres.bodies[name].inertia) * 1e9
        np.testing.assert_allclose(small, millimetres.bodies[name].inertia, rtol=1e-9, atol=1e-9)
    assert metres.joints["foot"].radial_clearance == pytest.approx(5e-5, abs=1e-14)
    np.testing.assert_allclose(metres.joints["toe"].journal.point, (math.hypot(6, 30) / 1e3, 0, 7.55e-3), atol=1e-12)


def test_what_the_file_says_stays(load):
    """Numbers of the mechanism file go before those of the CAD file; the inertia goes with the mass."""
    data = changed("bodies", "crank", {"part": "crank", "mass": 30.0, "material": "steel"})
    data = changed("joints", "foot", "rings", [0.0], data=data)
    drawn, own = load(latch_file()), load(data)
    assert own.bodies["crank"].mass == 30.0
    ratio = 30.0 / drawn.bodies["crank"].mass
    np.testing.assert_allclose(own.bodies["crank"].inertia, np.array(drawn.bodies["crank"].inertia) * ratio, rtol=1e-9)
    assert own.joints["foot"].rings == (0.0,)
    assert own.geometry.bodies["bodies.crank"].mass == 30.0


def test_a_density(load):
    """A density of the mechanism file goes before that of the CAD file."""
    own = load(changed("bodies", "crank", "density", 2 * 7.85e-3))
    assert own.bodies["crank"].mass == pytest.approx(2 * load(latch_file()).bodies["crank"].mass, rel=1e-11)
    assert own.geometry.bodies["bodies.crank"].density_from == "this file"


@pytest.mark.parametrize("density", [-1.0, [7.85e-3, 7.85e-3], "7.85e-3"])
def test_no_density(load, density):
    """A density that the part cannot have."""
    found = faults(load, changed("bodies", "crank", "density", density))
    assert "allowed: a number > 0" in found["bodies.crank.density"].text


def test_the_certificate(load):
    """Clearances as drawn, offset and tilt of the axes, recognition gaps, masses."""
    certificate = load(latch_file()).geometry
    assert certificate.joints["foot"].clearance == pytest.approx(0.05, abs=1e-9)
    assert all(joint.axis_offset < 1e-9 and joint.tilt < 1e-12 for joint in certificate.joints.values())
    assert certificate.faces["contacts.stop.b"].kind == "plane"
    assert all(face.recognition_gap == 0.0 for face in certificate.faces.values())
    crank = certificate.bodies["bodies.crank"]
    assert crank.drawn_mass == pytest.approx(7.85e-3 * crank.volume, rel=1e-12)
    assert "steel" in crank.density_from


def test_the_digest_follows_the_numbers(load, tmp_path):
    """A comment in the STEP file changes nothing but its SHA-256; a face does."""
    commented = tmp_path / "commented.step"
    commented.write_bytes(LATCH.read_bytes().replace(b"DATA;", b"DATA;\n/* drawn on a Monday */", 1))
    first, second = load(latch_file()), load(latch_file(commented))
    assert first.geometry.sha256 != second.geometry.sha256
    assert first.digest() == second.digest()
    assert first.digest() != load(changed("joints", "foot", "radial_clearance", 0.06)).digest()


def test_what_a_worker_gets(load):
    """A plan holds plain numbers: the same mechanism comes of them without the CAD file."""
    mechanism = load(latch_file())
    again = mechanism_from(mechanism.model_dump(mode="json", by_alias=True, exclude_none=True), "plan")
    assert again.digest() == mechanism.digest()
    assert again.geometry == mechanism.geometry
    assert not {"cad", "part", "hole"} & set(str(mechanism.model_dump(exclude={"geometry"})).split("'"))


@each(
    ("path", "value", "key", "words"),
    [
        (("cad", "sha256"), "0" * 64, "cad.sha256", "has another content"),
        (("cad", "sha256"), "0", "cad.sha256", "64 hexadecimal digits"),
        (("cad", "file"), "none.step", "cad.file", "cannot be read"),
        (("cad", "recognition"), -1.0, "cad.recognition", "allowed: >= 0"),
        (("bodies", "crank", "part"), "crnk", "bodies.crank.part", "did you mean 'crank'?"),
        (("joints", "foot", "bearing", "hole", "radius"), 3.0, "joints.foot.bearing.hole", "radius = 3.05, near = [0,"),
        (("joints", "foot", "journal", "pin", "radius"), None, "joints.foot.journal.pin.radius", "missing"),
        (("joints", "foot", "journal", "body"), "nobody", "joints.foot.journal.body", "base, crank, rocker"),
        (("contacts", "stop", "b", "body"), {"J1": "base"}, "contacts.stop.b.body", "no body that is a part"),
        (("joints", "foot", "bearing", "hole", "far"), 1.0, "joints.foot.bearing.hole.far", "unknown key"),
        (
            ("contacts", "stop", "b", "plane", "near"),
            [7.8, 14.0, 9.0],
            "contacts.stop.b.plane",
            "with normal [-1, 0, 0]",
        ),
        (("contacts", "stop", "b", "plane", "within"), 90.0, "contacts.stop.b.plane", "fit within 90"),
        (("joints", "heel", "journal", "pin", "near"), [0.0, 0.0, 2.5], "joints.heel.journal.pin", "50 from that of"),
        (("geometry",), {}, "geometry", "not by hand"),
    ],
)
def test_faults(load, path, value, key, words):
    """Every fault has its key, and says what is there instead."""
    found = faults(load, changed(*path, value))
    assert words in found[key].text
    assert found[key].line is not None


def test_another_content_says_which_command_brings_the_file_to_it(load):
    """The command is complete: with the STEP file and the mechanism file."""
    said = faults(load, changed("cad", "sha256", "0" * 64))["cad.sha256"].text
    command = said.partition("with clearcap mechanism import ")[2].split()
    assert [each.rpartition("/")[2] for each in command] == ["latch.step", "--update", "latch.toml"]


def test_all_faults_at_once(load):
    """A user corrects them in one go."""
    data = changed("joints", "foot", "bearing", "hole", "radius", 3.5)
    data = changed("joints", "toe", "bearing", "hole", "radius", 3.5, data=data)
    assert set(faults(load, data)) == {"joints.foot.bearing.hole", "joints.toe.bearing.hole"}


def test_as_drawn_needs_two_faces(load):
    """A clearance is drawn only between a hole and a pin."""
    data = latch_file()
    data["joints"]["foot"]["journal"] = {"body": "base", "point": [0, 0, 2.5], "axis": [0, 0, 1], "radius": 3.05}
    assert "only between faces" in faults(load, data)["joints.foot.radial_clearance"].text


def test_text_opens_no_file(monkeypatch):
    """A mechanism that comes as text names no file that would be opened."""
    monkeypatch.setattr("engine.mechanism.geometry.resolved_geometry.read_step", None)
    with pytest.raises(MechanismError, match="none is opened for a mechanism that comes as text"):
        load_mechanism_text(tomli_w.dumps(latch_file()))


@pytest.mark.processes
def test_the_engine_alone_reads_no_cad():
    """Whoever imports the engine, or loads a plain mechanism, gets neither OCP nor SciPy's rotations."""
    code = "import sys, engine; engine.load_mechanism('c60'); print([m for m in sys.modules if m in ('OCP', 'scipy')])"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ)
    assert printed.stdout.strip() == "[]", printed.stderr
