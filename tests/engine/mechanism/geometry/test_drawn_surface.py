"""Faces of CAD parts as surfaces of contacts: their distances against those of OCCT, and what is refused."""

import hashlib
import re
from math import pi
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex
from OCP.BRepClass3d import BRepClass3d_SolidClassifier
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.BRepPrimAPI import BRepPrimAPI_MakeSphere
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.TopAbs import TopAbs_State
from scipy.spatial.transform import Rotation

from clearcap.cli import main
from clearcap.questions.mechanisms import geometry_lines, geometry_provenance
from engine import MechanismError, load_mechanism
from engine.cad.occt.step_assembly import read_assembly
from engine.mechanism import mechanism_from
from tests.each import each
from tests.engine.cad.spline_shapes import elliptic_cam, parabolic_bowl, spline_surface, standing_on
from tests.engine.cad.step_files import box, cut, cylinder, faces, place
from tests.engine.kernels.shapes import Poses, found
from tests.engine.kernels.surface_shapes import wavy
from tests.engine.kernels.test_surfaces_occt import over
from tests.engine.mechanism.geometry.surface_files import one_part, surface_file, written

pytestmark = pytest.mark.processes

BOWL = {"faces": [{"near": [0.0, 0.0, 0.0]}]}
WAVY = wavy(9, 8, 0.4)


SHEET = spline_surface(WAVY["control"], (3, 3), (WAVY["knots_u"], WAVY["knots_v"]))
MIDDLE = SHEET.Value(0.5, 0.5)


def wavy_block():
    """Return a block whose top is a bicubic sheet with hills and hollows."""
    return standing_on(SHEET, 3.0)


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Return a function that writes a drawing and a file whose contact has faces of it, and loads the file.

    OCCT runs in this process, which has loaded it already.
    """

    def read_here(path, recognition):
        return read_assembly(Path(path), hashlib.sha256(Path(path).read_bytes()).hexdigest(), recognition)

    monkeypatch.setattr("engine.mechanism.geometry.resolved_geometry.read_step", read_here)

    def loaded(drawing, surface, how=None, **more):
        path = tmp_path / "faces.toml"
        path.write_text(tomli_w.dumps(surface_file(written(drawing, tmp_path, **(how or {})), surface, **more)))
        return load_mechanism(path)

    return loaded


def faults(load, *args, **more):
    """Return what is said of a file, by its keys."""
    with pytest.raises(MechanismError) as error:
        load(*args, **more)
    return {fault.key: fault.text for fault in error.value.faults}


def gaps(mechanism, points, name="touch"):
    """Return the gaps, and normals, of points of the world over a surface, in the start pose."""
    contact, n = mechanism.contacts[name], len(points)
    body = mechanism.bodies[contact.b.body]
    turn = Rotation.from_rotvec(body.angle * np.array(body.axis)).as_matrix() if body.angle else np.eye(3)
    still = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
    poses = Poses((points, np.tile(body.origin, (n, 1))), (still, np.broadcast_to(turn, (n, 3, 3)).copy()))
    gap, _, frame = found(contact, poses)
    return gap, frame[:, 0]


def by_occt(solid, face, points):
    """Return the signed distances of points from a face of a solid, by OCCT."""
    values, classifier = [], BRepClass3d_SolidClassifier(solid)
    for point in points:
        at = gp_Pnt(*map(float, point))
        far = BRepExtrema_DistShapeShape(BRepBuilderAPI_MakeVertex(at).Vertex(), face).Value()
        classifier.Perform(at, 1e-12)
        values.append(-far if classifier.State() == TopAbs_State.TopAbs_IN else far)
    return np.array(values)


def mirrored_place():
    """Return the place of a mirrored instance, turned and moved too."""
    mirror = place()
    mirror.SetMirror(gp_Ax2(gp_Pnt(1.0, -2.0, 0.5), gp_Dir(0.36, 0.48, 0.8)))
    return mirror


PLACES = {"as drawn": place, "turned": lambda: place(20.0, -5.0, 3.0, 0.7), "mirrored": mirrored_place}


@pytest.mark.parametrize("count", [150, pytest.param(3000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", list(PLACES))
def test_distances_are_those_of_occt(load, name, count):
    """On both sides of a face of no more than the third degree, in every instance, to 1e-9."""
    where, shape, rng = PLACES[name](), wavy_block(), np.random.default_rng(1)
    top = next(face for face in faces(shape) if touches(face, MIDDLE))
    drawn = over(SHEET, rng.uniform(-0.3, 1.0, count), rng)
    wanted = by_occt(shape, top, drawn)
    points = np.array([array(gp_Pnt(*map(float, point)).Transformed(where)) for point in drawn])
    # the frame of a body is never a mirrored one: of a mirrored part it has the other z
    near = (array(MIDDLE) * [1, 1, -1 if name == "mirrored" else 1]).tolist()
    mechanism = load(one_part(shape, where), {"faces": [{"near": near}], "depth": 1.0})
    gap, _ = gaps(mechanism, points)
    np.testing.assert_allclose(gap, wanted, rtol=0, atol=1e-9)
    assert np.count_nonzero(wanted < 0) > 0.1 * count
    [face] = mechanism.geometry.faces.values()
    assert face.kind == "surface"
    assert 0 <= face.conversion_error < 1e-12


def touches(face, point):
    """Return whether a point is on a face."""
    return BRepExtrema_DistShapeShape(BRepBuilderAPI_MakeVertex(point).Vertex(), face).Value() < 0.05


def array(point):
    """Return a point of OCCT."""
    return np.array([point.X(), point.Y(), point.Z()])


@pytest.mark.parametrize("unit", ["INCH", "M"])
def test_units_of_the_file(load, unit):
    """A paraboloid, drawn in inches or metres: its height over points on it and beside it."""
    surface = load(one_part(parabolic_bowl()), BOWL, how={"unit": unit}).contacts["touch"].b.surface
    middle = surface.top[..., :2].reshape(-1, 3 - 1)
    assert np.abs(middle).max() == pytest.approx(6.0, abs=1e-9)
    mechanism = load(one_part(parabolic_bowl()), BOWL, how={"unit": unit})
    x, y = np.random.default_rng(0).uniform(-4, 4, (2, 50))
    z, slope = (x**2 + y**2) / 20, np.stack([-x / 10, -y / 10, np.ones(50)], axis=-1)
    n = slope / np.linalg.norm(slope, axis=1)[:, None]
    gap, normal = gaps(mechanism, np.stack([x, y, z], axis=-1) + 0.2 * n)
    np.testing.assert_allclose(gap, 0.2, atol=1e-8)
    np.testing.assert_allclose(normal, n, atol=1e-8)


def test_in_si(load):
    """The same file in metres: the surface and its errors are a thousandth."""
    drawn = one_part(cylinder((0.0, 0.0, 0.0), 3.0, 4.0))
    near = {"faces": [{"near": [3.0, 0.0, 2.0]}], "conversion": 1e-6}
    small = {"faces": [{"near": [3e-3, 0.0, 2e-3]}], "conversion": 1e-9}
    millimetres, metres = load(drawn, near), load(drawn, small, units="SI")
    one, other = (m.contacts["touch"].b.surface.top for m in (millimetres, metres))
    np.testing.assert_allclose(other, one / 1e3, atol=1e-12)
    errors = [next(iter(m.geometry.faces.values())).conversion_error for m in (millimetres, metres)]
    assert errors[1] == pytest.approx(errors[0] / 1e3, rel=1e-3)


@pytest.mark.parametrize("shape", ["cylinder", "sphere", "hole", "plane"])
def test_analytic_faces(load, shape):
    """A face that has a closed form may be a surface too: its gaps are the closed form's, within the stated error."""
    block = cut(box((-6.0, -6.0, 0.0), (12.0, 12.0, 5.0)), cylinder((0.0, 0.0, -1.0), 3.0, 8.0))
    rng = np.random.default_rng(2)
    out, z = Rotation.random(200, random_state=rng).apply([0.0, 0.0, 1.0]), rng.uniform(1.0, 4.0, 200)
    flat = out * [1, 1, 0] / np.linalg.norm(out[:, :2], axis=1)[:, None]
    height, up = rng.uniform(-0.2, 0.5, 200), z[:, None] * [0, 0, 1]
    drawn, near, points = {
        "cylinder": (cylinder((0, 0, 0), 3.0, 5.0), [3.0, 0.0, 2.0], (3 + height)[:, None] * flat + up),
        "sphere": (BRepPrimAPI_MakeSphere(3.0).Shape(), [0.0, 3.0, 0.0], (3 + height)[:, None] * out),
        "hole": (block, [3.0, 0.0, 2.0], (3 - height)[:, None] * flat + up),
        "plane": (block, [6.0, 0.0, 2.0], np.stack([6 + height, 5 * out[:, 0], z], axis=-1)),
    }[shape]
    allowed = 2e-5 if shape == "sphere" else 1e-7
    mechanism = load(one_part(drawn), {"faces": [{"near": near}], "conversion": allowed})
    [face] = mechanism.geometry.faces.values()
    assert (1e-14 < face.conversion_error <= 1.001 * allowed) == (shape != "plane")
    gap, _ = gaps(mechanism, points)
    np.testing.assert_allclose(gap, height, rtol=0, atol=face.conversion_error + 1e-12)


def test_a_window_in_a_face_is_no_contact(load):
    """Where the face has been cut out there is nothing: a point sinks in, and what it meets are the edges."""
    frame = cut(box((0.0, 0.0, 0.0), (9.0, 9.0, 5.0)), box((3.0, 2.0, -1.0), (4.0, 5.0, 9.0)))
    surface = {"faces": [{"near": [1.0, 1.0, 5.0]}], "depth": 2.0}
    x, y, z = np.random.default_rng(3).uniform([3.1, 2.1, 4.0], [6.9, 6.9, 7.0], (300, 3)).T
    away = np.minimum(np.minimum(x - 3, 7 - x), np.minimum(y - 2, 7 - y))
    gap, _ = gaps(load(one_part(frame), surface), np.stack([x, y, z], axis=-1))
    np.testing.assert_allclose(gap, np.hypot(away, np.maximum(z - 5.0, 0.0)), atol=1e-12)
    over = np.array([[1.0, 1.0, 5.5], [8.0, 4.0, 5.25], [5.0, 8.0, 4.9]])
    np.testing.assert_allclose(gaps(load(one_part(frame), surface), over)[0], [0.5, 0.25, -0.1], atol=1e-12)


def test_all_faces_of_a_box_are_the_box(load):
    """Six faces that meet at sharp edges: no plate is put behind them, and distances are those of the box."""
    middles = [[4.0, 2.5, 3.0], [0.0, 2.5, 3.0], [2.0, 5.0, 3.0], [2.0, 0.0, 3.0], [2.0, 2.5, 6.0], [2.0, 2.5, 0.0]]
    surface = {"faces": [{"near": near} for near in middles]}
    mechanism = load(one_part(box((0.0, 0.0, 0.0), (4.0, 5.0, 6.0))), surface)
    assert len(mechanism.contacts["touch"].b.surface.boundary) == 6
    points = np.random.default_rng(4).uniform([-2, -2, -2], [6, 7, 8], (2000, 3))
    low, high = -points, points - [4.0, 5.0, 6.0]
    out = np.maximum(np.maximum(low, high), 0)
    inside = np.maximum(low, high).max(axis=1)
    gap, _ = gaps(mechanism, points)
    np.testing.assert_allclose(gap, np.where(inside > 0, np.linalg.norm(out, axis=1), inside), atol=1e-12)
    assert len(mechanism.geometry.faces) == 6


@pytest.mark.slow
def test_an_ellipse_by_its_outline(load):
    """A closed face with a seam: points of the ellipse have no gap, on its normals it is the distance."""
    a, b = 8.0, 5.0
    surface = {"faces": [{"near": [8.0, 0.0, 3.0]}], "conversion": 1e-7}
    mechanism = load(one_part(elliptic_cam(a, b, 6.0)), surface)
    angle = np.linspace(0, 2 * pi, 181)
    on = np.stack([a * np.cos(angle), b * np.sin(angle), np.full_like(angle, 3.0)], axis=-1)
    n = np.stack([b * np.cos(angle), a * np.sin(angle), 0 * angle], axis=-1)
    n /= np.linalg.norm(n, axis=1)[:, None]
    for height in (0.0, 1e-4, 0.5, -0.1):
        np.testing.assert_allclose(gaps(mechanism, on + height * n)[0], height, atol=2e-7)
    assert mechanism.geometry.faces["contacts.touch.b.surface.faces.0"].conversion_error <= 1e-7


def test_the_plan_needs_no_cad_file(load):
    """What a worker gets are control points; the mechanism is the same to the last bit."""
    mechanism = load(one_part(wavy_block()), {"faces": [{"near": array(MIDDLE).tolist()}]})
    again = mechanism_from(mechanism.model_dump(mode="json", by_alias=True, exclude_none=True), "plan")
    assert again.digest() == mechanism.digest()
    assert again.geometry == mechanism.geometry
    one, other = (m.contacts["touch"].b.surface.boundary for m in (mechanism, again))
    assert one.tobytes() == other.tobytes()


KEY = "contacts.touch.b.surface.faces.0"
CAN = {"faces": [{"near": [0.0, 0.0, 4.0]}]}
REFUSED = [
    ({"faces": [{"near": [0.0, 0.0, 30.0]}]}, KEY, "block has these, nearest first: the plane at"),
    ({"faces": [{"near": [2.9, 0.0, 4.0]}]}, KEY, "2 fit within 0.5"),
    (CAN, KEY, "its edges do not all run along parameter lines"),
    (CAN, KEY, "name its plane"),
    ({"faces": [{"near": [3.0, 0.0, 2.0]}, {"near": [-3.0, 0.0, 2.0]}]}, f"{KEY[:-1]}1", "named already"),
    ({"faces": [{"near": [3.0, 0.0]}]}, f"{KEY}.near", "not a vector"),
    ({"faces": [{"near": [3.0, 0.0, 2.0]}], "depth": 5.0}, "contacts.touch.b.surface.depth", "would fold"),
    ({"faces": [{"near": [3.0, 0.0, 2.0]}], "patches": []}, "contacts.touch.b.surface.patches", "unknown key"),
]


@each(("surface", "key", "words"), REFUSED)
def test_what_is_refused(load, surface, key, words):
    """A round bar: none, two, an end that no parameter lines bound, one face twice, and what the patches cannot be."""
    found = faults(load, one_part(cylinder((0.0, 0.0, 0.0), 3.0, 4.0)), surface)
    assert list(found) == [key]
    assert words in found[key]


@pytest.mark.slow
def test_the_command_says_it_once(tmp_path, monkeypatch, capsys):
    """A face that cannot be a surface: one message with its key, no traceback, exit code 2."""
    path = tmp_path / "faces.toml"
    drawn = written(one_part(cylinder((0.0, 0.0, 0.0), 3.0, 4.0)), tmp_path)
    path.write_text(tomli_w.dumps(surface_file(drawn, CAN)))
    monkeypatch.setattr("sys.argv", ["clearcap", "mechanism", "check", str(path)])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    said = capsys.readouterr().err
    assert said.count(KEY) == 1
    assert "Traceback" not in said


def test_the_error_is_stated_for_each_face(load):
    """What `check` prints, and what a report's provenance says."""
    mechanism = load(
        one_part(cylinder((0.0, 0.0, 0.0), 3.0, 4.0)), {"faces": [{"near": [3.0, 0.0, 2.0]}], "conversion": 1e-5}
    )
    printed = "\n".join(geometry_lines(mechanism))
    stated = re.search(rf"  {KEY}: surface, recognition gap 0 mm, conversion error (\S+) mm", printed)
    assert stated is not None
    assert 0 < float(stated[1]) <= 1e-5
    said = geometry_provenance(mechanism.geometry)["geometry from it"]
    assert f"largest recognition gap 0, conversion error {stated[1]}, axes" in said
