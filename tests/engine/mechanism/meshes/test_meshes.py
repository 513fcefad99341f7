"""Mesh files: what is read and refused, the pieces that a mesh becomes, and how far they are from it."""

import struct
from itertools import product

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from clearcap.questions.mechanisms import geometry_lines
from engine import load_mechanism, load_mechanism_text
from engine.errors import MechanismError
from engine.mechanism.meshes.decomposition import convex_pieces
from engine.mechanism.meshes.deviation import distances_from, largest_deviation
from engine.mechanism.meshes.resolved_meshes import solid_of
from engine.mechanism.meshes.stl import MOST_TRIANGLES, UnfitMesh, closed_mesh, triangles_of
from tests.each import each

CUBE = np.array(list(product((0.0, 1.0), repeat=3)))
ANGLE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)], [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
FORK = (
    [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)],
    [(0, 1, 5), (1, 4, 5), (1, 2, 4), (2, 3, 4), (0, 5, 7), (5, 6, 7)],
)
NOTCH = [(0, 0), (4, 0), (4, 2), (2, 1), (0, 2)], [(0, 1, 3), (1, 2, 3), (0, 3, 4)]


def hull_triangles(points):
    """Return the triangles of a convex hull, counterclockwise seen from outside."""
    hull = ConvexHull(points)
    triangles = points[hull.simplices]
    out = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inwards = np.einsum("ij,ij->i", out, hull.equations[:, :3]) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return triangles


def prism(section, height=2.0):
    """Return the triangles of a prism over a polygon, given with its triangles."""
    corners, triangles = section
    low = np.array([(*corner, 0.0) for corner in corners])
    high = np.array([(*corner, height) for corner in corners])
    found = [part for a, b, c in triangles for part in (high[[a, b, c]], low[[a, c, b]])]
    for i in range(len(low)):
        found += [np.array([low[i - 1], low[i], high[i]]), np.array([low[i - 1], high[i], high[i - 1]])]
    return np.array(found)


def binary(triangles):
    """Return a binary STL file."""
    rows = np.zeros(len(triangles), [("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")])
    rows["p"] = triangles
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + rows.tobytes()


def text(triangles):
    """Return an ASCII STL file."""
    lines = ["solid made"]
    for triangle in triangles.tolist():
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x!r} {y!r} {z!r}" for x, y, z in triangle)]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid made"]).encode()


def pieces_of(triangles, share=1e-3):
    """Return the pieces of a mesh, and the two bounds of its certificate."""
    mesh = closed_mesh(triangles)
    pieces = convex_pieces(mesh, share * mesh.size)
    return pieces, largest_deviation(mesh.points, pieces)


@each("write", [binary, text])
def test_both_kinds_of_file_are_read(write):
    mesh = closed_mesh(triangles_of(write(prism(FORK))))
    assert len(mesh.corners) == 16
    np.testing.assert_allclose(solid_of(mesh.points)[0], 14.0, rtol=1e-12)


UNFIT = [
    (binary(prism(FORK))[:-1], "no STL file"),
    (b"", "no STL file"),
    (b"solid nothing", "0 triangles"),
    (b"\0" * 80 + struct.pack("<I", 2**32 - 1), "no STL file"),
    (text(prism(FORK)).replace(b"3.0 0.0 0.0", b"3.0 zero 0.0"), "not three numbers"),
    (text(prism(FORK)).replace(b"3.0 0.0 0.0", b"3.0 nan 0.0"), "no length"),
    (binary(prism(FORK)[1:]), "not closed"),
    (binary(prism(FORK)[:, ::-1]), "inwards"),
    (binary(np.ones((4, 3, 3))), "single point"),
    (b"solid\n" + b"vertex 0 0 0\n" * 3 * (MOST_TRIANGLES + 1), f"allowed: 4 to {MOST_TRIANGLES}"),
]


@each("content, words", UNFIT)
def test_what_is_no_closed_surface_is_refused(content, words):
    with pytest.raises(UnfitMesh, match=words):
        closed_mesh(triangles_of(content))


@each("section, count", [(ANGLE, 2), (FORK, 3), (NOTCH, 2)])
def test_right_angles_are_cut_without_a_rest(section, count):
    """Few pieces, whose volumes add up to that of the solid, so that they neither overlap nor leave anything out."""
    triangles = prism(section)
    pieces, bounds = pieces_of(triangles)
    assert len(pieces) == count
    volumes = [ConvexHull(piece.hull.corners).volume for piece in pieces]
    np.testing.assert_allclose(sum(volumes), solid_of(triangles)[0], rtol=1e-9)
    assert max(bounds) < 1e-4


def test_a_convex_mesh_is_one_piece():
    pieces, bounds = pieces_of(hull_triangles(CUBE))
    assert [len(piece.hull.corners) for piece in pieces] == [8]
    assert [len(piece.hull.faces) for piece in pieces] == [6]
    assert max(bounds) <= 1e-5


def test_the_certificate_of_a_hull_over_a_notch():
    """The hull of the notched bar alone: its top is 1 above the bottom of the notch, which it hides 1 deep."""
    triangles = prism(NOTCH)
    _, (buried, bridging) = pieces_of(triangles, share=10.0)
    assert buried == pytest.approx(1.0, rel=1e-3)
    assert 2.0 / np.sqrt(5.0) <= bridging <= 1.03 * 2.0 / np.sqrt(5.0)  # from the middle of the top to a flank


def test_no_point_is_farther_than_the_certificate_says():
    """Of a rough ball with more corners than a piece has: points of both surfaces, drawn at random."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(220, 3))
    triangles = hull_triangles(5.0 * points / np.linalg.norm(points, axis=1)[:, None])
    (piece,), (to_pieces, to_mesh) = pieces_of(triangles, share=1.0)
    assert len(piece.hull.corners) == 128
    for own, other, bound in ((triangles, piece.hull.triangles, to_pieces), (piece.hull.triangles, triangles, to_mesh)):
        shares = rng.dirichlet((1.0, 1.0, 1.0), 300)
        drawn = np.einsum("ni,nij->nj", shares, own[rng.integers(len(own), size=300)])
        farthest = max(float(distances_from(point, other).min()) for point in drawn)
        assert farthest <= bound <= 3.0 * farthest


def test_mass_and_inertia_are_those_of_the_solid():
    """Of a box away from the origin, by its closed form; of an angle, by two boxes."""
    volume, centre, inertia = solid_of(hull_triangles(CUBE * (2.0, 3.0, 4.0) + (100.0, 0.0, -50.0)))
    np.testing.assert_allclose(volume, 24.0, rtol=1e-12)
    np.testing.assert_allclose(centre, [101.0, 1.5, -48.0], rtol=1e-12)
    np.testing.assert_allclose(inertia, np.diag([9 + 16, 4 + 16, 4 + 9]) * 2.0, atol=1e-9)
    volume, centre, _ = solid_of(prism(ANGLE))
    np.testing.assert_allclose(volume, 10.0, rtol=1e-12)
    np.testing.assert_allclose(centre[:2], [(6 * 1.5 + 4 * 0.5) / 10, (6 * 0.5 + 4 * 2.0) / 10], rtol=1e-12)


MECHANISM = """
format = 1
name = "meshes"
units = "mm-g-ms"

[simulation]
step = 0.1
horizon = 100.0
tolerance = 1e-8
penetration = 1e-8
rest = { window = 5.0, drift = 1e-7 }

[bodies.base]
fixed = true

[bodies.fork]
mesh = { file = "fork.stl" }
density = "steel"

[contacts.touch]
friction = 0.1
a = { body = "fork", mesh = { file = "fork.stl", deviation = 0.01 } }
b = { body = "base", mesh = { file = "angle.stl", scale = 2.0 } }
"""


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a mechanism and its two meshes."""
    (tmp_path / "fork.stl").write_bytes(binary(prism(FORK)))
    (tmp_path / "angle.stl").write_bytes(text(prism(ANGLE)))
    return tmp_path


def loaded(folder, content=MECHANISM):
    """Load a mechanism from a file in a folder."""
    (folder / "meshes.toml").write_text(content)
    return load_mechanism(folder / "meshes.toml")


def test_a_mechanism_has_pieces_masses_and_certificates(folder):
    mechanism = loaded(folder)
    assert len(mechanism.contacts["touch"].a.mesh.pieces) == 3
    assert mechanism.bodies["fork"].mass == pytest.approx(14.0 * 7.85e-3)
    certificate = mechanism.meshes["contacts.touch.b.mesh"]
    assert (certificate.file, certificate.pieces, certificate.triangles) == ("angle.stl", 2, 20)
    assert max(certificate.mesh_to_pieces, certificate.pieces_to_mesh) < 1e-4 < certificate.allowed
    assert any("3 convex pieces" in line for line in geometry_lines(mechanism))
    plain = load_mechanism_text(mechanism.to_toml())
    assert plain.digest() == mechanism.digest()


WRONG = [
    (('"fork.stl" }', '"gone.stl" }'), "bodies.fork.mesh.file"),
    (('file = "fork.stl", dev', 'file = "..", dev'), "contacts.touch.a.mesh.file"),
    (('"angle.stl"', '"meshes.toml"'), "contacts.touch.b.mesh.file"),
    (('"angle.stl"', '"a\\u0000b.stl"'), "contacts.touch.b.mesh.file"),
    (("scale = 2.0", "scale = 0.0"), "contacts.touch.b.mesh.scale"),
    (("scale = 2.0", "size = 2.0"), "contacts.touch.b.mesh.size"),
    (("0.01", "1e-9"), "contacts.touch.a.mesh.deviation"),
    (('density = "steel"', 'density = "cheese"'), "bodies.fork.density"),
    (('density = "steel"', ""), "bodies.fork.density"),
    (
        (
            'mesh = { file = "angle.stl", scale = 2.0 }',
            "cylinder = { point = [0, 0, 0], axis = [0, 0, 1], radius = 1.0 }",
        ),
        "contacts.touch",
    ),
    (
        ('{ file = "angle.stl", scale = 2.0 }', "{ pieces = [[[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]] }"),
        "contacts.touch.b.mesh.pieces.0",
    ),
]


@pytest.mark.parametrize(("change", "key"), WRONG)
def test_an_error_names_the_key(folder, change, key):
    assert change[0] in MECHANISM
    with pytest.raises(MechanismError) as error:
        loaded(folder, MECHANISM.replace(*change))
    assert [".".join(fault.keys) for fault in error.value.faults] == [key]


def test_no_file_is_opened_for_a_text():
    with pytest.raises(MechanismError) as error:
        load_mechanism_text(MECHANISM)
    assert ("contacts", "touch", "a", "mesh", "file") in [fault.keys for fault in error.value.faults]
