"""Parts that are one body: what is proposed, what a body of several parts weighs, what an edit of the list changes."""

import tomllib
from math import pi

import numpy as np
import pytest
from typer.testing import CliRunner

from clearcap.cli import app
from engine import MechanismError, load_mechanism
from engine.cad import read_step
from engine.cad.findings.standard_parts import gear_teeth
from engine.cad_import.found_geometry import find_geometry
from engine.cad_import.proposed_groups import PartGroup, groups_of_bodies, listed_groups, updated_groups
from engine.cad_import.proposed_mechanism import proposed_mechanism, unloaded_directions
from tests.engine.cad.bought import COIL, gearbox
from tests.engine.cad.crane import ARM, BORE, COVER, FOOT, PLAY, WEIGHT, board, crane, gears, pedals, torsion_spring

pytestmark = pytest.mark.processes

HEAD = """\
format = 1
name = "crane"
units = "mm-g-ms"
[simulation]
step = 0.1
horizon = 20.0
penetration = 1e-6
rest = { window = 2.0, drift = 1e-5 }
"""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Return the path of the crane."""
    return crane().write(tmp_path_factory.mktemp("crane") / "crane.step")


def imported(folder, *words):
    """Return what the import prints."""
    done = CliRunner().invoke(app, ["mechanism", "import", *map(str, words)])
    assert done.exit_code == 0, done.exception
    return done.stdout


def loaded(folder, drawn, text):
    """Return a mechanism with bodies of the crane."""
    path = folder / "crane.toml"
    sha = read_step(drawn).sha256
    path.write_text(f'{HEAD}[cad]\nfile = "{drawn}"\nsha256 = "{sha}"\n{text}')
    return load_mechanism(path)


def test_what_is_proposed(drawn):
    """The arm with its weight as a subassembly, the cover with what it lies on; joint and gap are between bodies."""
    found = find_geometry(read_step(drawn))
    assert found.groups == (
        PartGroup("foot", ("foot", "cover"), "by touching faces"),
        PartGroup("arm", ("arm", "weight"), "by subassembly"),
    )
    [joint] = found.joints
    assert (joint.pin.journal, joint.pin.bearing, len(joint.flanges)) == ("foot", "arm", 2)
    assert found.stops == ()
    text = proposed_mechanism(found, "crane.step", "crane")
    tables = tomllib.loads(text)
    assert tables["groups"] == {"foot": ["foot", "cover"], "arm": ["arm", "weight"]}
    assert {name: body["parts"] for name, body in tables["bodies"].items()} == tables["groups"]
    assert "#? groups: is each of these one rigid body" in text
    assert [each.partition(",")[0] for each in unloaded_directions(found, text).motions] == [
        "arm along z",
        "arm about z",
    ]


def test_a_body_of_several_parts(drawn, tmp_path):
    """Mass, centre and inertia are those of two blocks, by the theorem of Steiner; the frame is that of the first."""
    body = loaded(tmp_path, drawn, '[bodies.base]\nfixed = true\n[bodies.arm]\nparts = ["arm", "weight"]\n').bodies[
        "arm"
    ]
    rho = 7.85e-3
    sizes = np.array([ARM, WEIGHT])
    masses = [rho * np.prod(ARM), rho * np.prod(WEIGHT), -rho * pi * BORE**2 * ARM[2]]
    centres = np.array([(14.0, 0.0, 2.5), (25.0, 0.0, ARM[2] + 3.0), (0.0, 0.0, 2.5)])
    moments = [m * (np.eye(3) * (s @ s) - np.diag(s**2)) / 12 for m, s in zip(masses, sizes, strict=False)]
    across = masses[2] * (3 * BORE**2 + ARM[2] ** 2) / 12
    moments.append(np.diag([across, across, masses[2] * BORE**2 / 2]))
    centre = np.average(centres, axis=0, weights=masses)
    inertia = sum(
        own + m * ((r @ r) * np.eye(3) - np.outer(r, r))
        for own, m, r in zip(moments, masses, centres - centre, strict=True)
    )
    assert body.mass == pytest.approx(sum(masses), rel=1e-9)
    np.testing.assert_allclose(body.center_of_mass, centre, atol=1e-9)
    np.testing.assert_allclose(body.inertia, inertia, rtol=1e-8, atol=1e-6)
    np.testing.assert_allclose(body.origin, (0.0, 0.0, PLAY), atol=1e-12)


def test_faces_of_all_parts(drawn, tmp_path):
    """A contact names a face of the second part, in the frame of the first; OCCT measures the same distance."""
    text = f"""
[bodies.base]
fixed = true
parts = ["foot", "cover"]
[bodies.arm]
parts = ["arm", "weight"]
[contacts.top]
friction = 0.1
a = {{ body = "base", point = [30.0, 0.0, 40.0] }}
b = {{ body = "arm", plane = {{ near = [25.0, 0.0, {ARM[2] + WEIGHT[2]}] }} }}
"""
    mechanism = loaded(tmp_path, drawn, text)
    assert mechanism.contacts["top"].b.plane.normal == (0.0, 0.0, 1.0)
    drawn_gap = mechanism.geometry.gaps["contacts.top"].drawn
    assert drawn_gap == pytest.approx(40.0 - ARM[2] - WEIGHT[2] - PLAY, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[bodies.a]\nparts = ["arm", "wate"]', "no such part; allowed: foot, cover, arm, weight"),
        ('[bodies.a]\nparts = ["arm", "arm"]', "named twice"),
        ("[bodies.a]\nparts = []", "no list of parts"),
        ('[bodies.a]\npart = "arm"\nparts = ["arm"]', "not beside part"),
        ('[groups]\na = ["arm"]\n[bodies.a]\nparts = ["arm", "weight"]', "groups.a .* --update"),
    ],
)
def test_what_is_wrong_with_a_list(drawn, tmp_path, text, said):
    """Each fault names its key and what to do."""
    with pytest.raises(MechanismError, match=f"(?s){said}"):
        loaded(tmp_path, drawn, text)


def test_an_edited_list(drawn, tmp_path):
    """`--update` brings bodies to the list; what a person wrote beside it stays."""
    path = tmp_path / "crane.toml"
    said = imported(tmp_path, drawn, "-o", path, "--no-pictures")
    assert "group arm: arm, weight (by subassembly)" in said
    text = path.read_text().replace("friction = 0.0", "friction = 0.17")
    path.write_text(text.replace('foot = ["foot", "cover"]', 'foot = ["foot"]'))
    with pytest.raises(MechanismError, match=r"groups\.foot"):
        load_mechanism(path)
    said = imported(tmp_path, drawn, "--update", path)
    edited = tomllib.loads(path.read_text())
    assert edited["groups"]["foot"] == ["foot"]
    assert edited["materials"]["contact"]["friction"] == 0.17
    assert {name: body.get("part") or body["parts"] for name, body in edited["bodies"].items()} == {
        "foot": "foot",
        "cover": "cover",
        "arm": ["arm", "weight"],
    }
    assert "[contacts.stop-1]" in path.read_text()  # the cover may part from the foot now
    load_mechanism(path)
    apart = path.read_text().replace('foot = ["foot"]', 'foot = ["foot", "cover"]')
    path.write_text(apart)
    imported(tmp_path, drawn, "--update", path)
    again = tomllib.loads(path.read_text())
    assert again["bodies"]["foot"]["parts"] == ["foot", "cover"]
    assert "part" not in again["bodies"]["foot"]
    assert "cover" not in again["bodies"]
    load_mechanism(path)
    path.write_text(apart.replace('part = "cover"', 'density = "POM"\npart = "cover"'))
    assert "bodies.cover" in imported(tmp_path, drawn, "--update", path)
    assert tomllib.loads(path.read_text())["bodies"]["cover"]["density"] == "POM"  # what a person wrote stays


def test_a_new_revision(drawn, tmp_path):
    """A part of a group that is renamed stays in it, and one that is new joins the group of what it lies on."""
    path = tmp_path / "crane.toml"
    imported(tmp_path, drawn, "-o", path, "--no-pictures")
    assert groups_of_bodies(path.read_text()) == listed_groups(path.read_text())
    new = crane(cover="lid", more="foil").write(tmp_path / "new.step")
    imported(tmp_path, new, "--update", path)
    tables = tomllib.loads(path.read_text())
    assert tables["groups"]["foot"] == ["foot", "lid", "foil"]
    assert tables["bodies"]["foot"]["parts"] == ["foot", "lid", "foil"]


def test_listed_groups_come_first():
    """A person's list is never taken apart by a proposal; without a table of groups there is none."""
    listed = [PartGroup("base", ("a", "b"))]
    proposed = [PartGroup("a", ("a", "c")), PartGroup("n", ("n", "m")), PartGroup("d", ("d", "e"))]
    names = {name: name for name in "abcde"}
    found = updated_groups(listed, proposed, names, list("abcdenm"))
    assert found == [PartGroup("base", ("a", "b")), PartGroup("n", ("n", "m"))]
    assert listed_groups("a = 1\n") is None


def test_a_coil_is_a_spring(tmp_path):
    """It is no body, and its proposed table has the stiffness G d^4 / (8 D^3 n) of its wire, between its two ends."""
    drawing = gearbox(bolts=2).write(tmp_path / "gearbox.step")
    path = tmp_path / "gearbox.toml"
    said = imported(tmp_path, drawing, "-o", path, "--no-pictures")
    assert "\n4 fasteners: 2 BOLT (by its name), 2 NUT (by its name)\n" in said
    assert "\nspring coil: between shelf and lid\n" in said
    lines = path.read_text().partition("# [springs.coil]")[2].splitlines()[1:6]
    spring = tomllib.loads("\n".join(line.removeprefix("# ") for line in lines))
    exact = 81500 * COIL["wire"] ** 4 / (8 * (2 * COIL["radius"]) ** 3 * COIL["turns"])
    assert spring["stiffness"] == pytest.approx(exact, rel=0.02)
    assert (spring["a"]["body"], spring["b"]["body"]) == ("shelf", "lid")
    np.testing.assert_allclose(np.subtract(spring["b"]["point"], spring["a"]["point"]), [0, 0, 13], atol=0.05)


def test_a_spring_by_its_name(tmp_path):
    """One with legs in two parts is no body that would lock them, but turns them about the axis of its turns."""
    drawing, path = torsion_spring().write(tmp_path / "brake.step"), tmp_path / "brake.toml"
    said = imported(tmp_path, drawing, "-o", path, "--no-pictures")
    assert "\nspring Schenkelfeder: between base and lever\n" in said
    tables = tomllib.loads(path.read_text())
    assert (list(tables["bodies"]), list(tables["joints"])) == (["base", "lever"], ["base-lever"])
    lines = path.read_text().partition("# [springs.Schenkelfeder]")[2].splitlines()[1:7]
    spring = tomllib.loads("\n".join(line.removeprefix("# ") for line in lines))
    assert (spring["type"], spring["a"], spring["b"]) == ("torsion", "base", "lever")
    np.testing.assert_allclose(np.abs(spring["axis"]), [0, 1, 0], atol=1e-9)
    assert "Of Schenkelfeder only the name says" in path.read_text()


def test_gears_by_their_names(tmp_path):
    """Which mesh is asked; the marked pair is one once it has a module, on the axes of its joints, with its teeth."""
    drawing, path = gears().write(tmp_path / "gears.step"), tmp_path / "gears.toml"
    imported(tmp_path, drawing, "-o", path, "--no-pictures")
    text = path.read_text()
    assert "#? couplings: which of Spur-gear-24-teeth, Ritzel-z36 mesh?" in text
    lines = text.partition("# [couplings.mesh]")[2].splitlines()[1:4]
    mesh = tomllib.loads("\n".join(line.removeprefix("# ") for line in lines))
    assert [gear["teeth"] for gear in mesh["gears"]] == [24, 36]
    assert [gear["point"][:2] for gear in mesh["gears"]] == [[0.0, 0.0]] * 2
    whole = text.replace("# [couplings", "[couplings").replace("\n# gears", "\ngears").replace("\n# module", "\nmodule")
    path.write_text(whole.replace("\n# backlash", "\nbacklash").replace("\n# fixed", "\nfixed"))
    assert load_mechanism(path).couplings["mesh"].centre_distance == 30.0
    assert [gear_teeth(name) for name in ("GEAR housing", "gearbox", "Planet Gear", "gear_17T")] == [None, None, 0, 17]


def test_components_join_their_board(tmp_path):
    """A gap as of solder is none; what is farther away is a body of its own."""
    found = find_geometry(read_step(board().write(tmp_path / "sensor.step")))
    parts = ("carrier", "R_0805_2012Metric-1", "R_0805_2012Metric-2")
    assert found.groups == (PartGroup("carrier", parts, "by circuit board"),)
    assert list(found.bodies) == ["carrier", "lid"]


def test_a_subassembly_in_two_places(tmp_path):
    """Two pedals on a rod are one subassembly, but turn each for itself."""
    found = find_geometry(read_step(pedals().write(tmp_path / "car.step")))
    assert {group.parts for group in found.groups} == {("arm-1", "plate-1"), ("arm-2", "plate-2")}
    turning = {(joint.pin.journal, joint.pin.bearing) for joint in found.joints}
    assert turning == {("rod", "arm-1"), ("rod", "arm-2"), ("rod", "stand")}


def test_one_body_is_no_mechanism(drawn):
    """If everything would be one body, nothing is grouped: a person may know better."""
    assembly = read_step(drawn)
    assert len(find_geometry(assembly, [PartGroup("all", ("foot", "cover", "arm", "weight"))]).assembly.parts) == 1
    assert COVER[0] * COVER[1] < FOOT[0] * FOOT[1]
