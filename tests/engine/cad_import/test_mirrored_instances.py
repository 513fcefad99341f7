"""Mirrored instances of a part are what its mirror image, drawn as a part of its own, would be."""

import tomllib
from dataclasses import dataclass
from math import pi

import numpy as np
import pytest
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
from scipy.spatial.transform import Rotation

from engine.cad.cad_model import CadAssembly
from engine.cad.occt.step_assembly import read_assembly
from engine.cad_import.found_geometry import FoundGeometry, find_geometry
from engine.cad_import.proposed_mechanism import proposed_mechanism
from engine.mechanism import mechanism_from
from engine.mechanism.geometry.resolved_geometry import without_selectors
from tests.engine.cad.step_files import Drawing, box, cut, cylinder, fused, place

PIN, BORE, PLAY, HIGH = 3.0, 3.05, 0.05, 5.0
STEEL = ("steel", 7.85)
AT = {"left": (-40.0, 7.0), "right": (40.0, 7.0)}


def arm():
    """Return an arm without a plane of symmetry: a hole at the origin, a hook at its end, a pin on the hook."""
    bar = fused(box((-6.0, -6.0, 0.0), (30.0, 12.0, HIGH)), box((18.0, 6.0, 0.0), (6.0, 9.0, 3.0)))
    return cut(fused(bar, cylinder((21.0, 12.0, 3.0), 1.5, 4.0)), cylinder((0, 0, -1), BORE, HIGH + 2))


def base():
    """Return a plate with two pins, and with a block against which the left arm may swing."""
    plate = box((-60.0, -20.0, -4.0), (120.0, 40.0, 4.0))
    return fused(plate, *(cylinder((x, y, 0.0), PIN, HIGH + 2) for x, y in AT.values()))


def mirror(normal=(1.0, 0.0, 0.0)):
    """Return the mirror in a plane through the origin."""
    made = gp_Trsf()
    made.SetMirror(Drawing.plane((0.0, 0.0, 0.0), normal))
    return made


def turned(about, angle):
    """Return a turn about an axis through the origin."""
    turn = gp_Trsf()
    turn.SetRotation(gp_Ax1(gp_Pnt(), gp_Dir(*about)), angle)
    return turn


def shifted(x=0.0, y=0.0, z=0.0):
    """Return a shift."""
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(x, y, z))
    return move


WAYS = {
    "mirrored": mirror(),
    "mirrored and turned": turned((0, 0, 1), 0.7).Multiplied(mirror((0.0, 1.0, 0.0))),
    "upside down": shifted(z=HIGH).Multiplied(mirror((0.6, 0.8, 0.0))).Multiplied(turned((1, 0, 0), pi)),
    "mirrored along the axis": shifted(z=HIGH).Multiplied(mirror((0.0, 0.0, 1.0))),
}


def two_arms(how, *, drawn):
    """Return a base with an arm on its right pin, and on its left one as an instance, or `drawn` as another part."""
    made = Drawing()
    top = made.assembly("two arms")
    made.add(top, made.product("base", base(), STEEL), name="base")
    product = made.product("arm", arm(), STEEL)
    made.add(top, product, place(*AT["right"], PLAY, 0.4), "right")
    at = shifted(*AT["left"], PLAY)
    if drawn:
        image = BRepBuilderAPI_Transform(arm(), how, True).Shape()
        made.add(top, made.product("arm", image, STEEL), at, "left")
    else:
        made.add(top, product, at.Multiplied(how), "left")
    return made


@dataclass(frozen=True)
class World:
    """What an import makes of a drawing, in the frame of the world."""

    assembly: CadAssembly
    found: FoundGeometry
    bodies: list  # mass, centre, inertia
    axes: list  # points of the bearing and of the journal of each joint, and of the axes of both


def imported(drawing, path):
    """Return what is proposed for a drawing, with numbers in place of its faces."""
    assembly = read_assembly(drawing.write(path), "0" * 64, 1e-4)
    found = find_geometry(assembly)
    plain, _ = without_selectors(tomllib.loads(proposed_mechanism(found, "arms.step", "arms")), found.drawn)
    mechanism = mechanism_from(plain, "arms")
    places = {
        name: (np.array(body.origin), Rotation.from_rotvec(body.angle * np.array(body.axis)).as_matrix())
        for name, body in mechanism.bodies.items()
    }
    bodies = [
        (body.mass, places[name][0] + places[name][1] @ body.center_of_mass, turn @ np.array(body.inertia) @ turn.T)
        for (name, body), (_, turn) in zip(mechanism.bodies.items(), places.values(), strict=True)
    ]
    axes = []
    for joint in mechanism.joints.values():
        for end in (joint.bearing, joint.journal):
            origin, turn = places[end.body]
            axes.append((origin + turn @ end.point, turn @ end.axis))
    return World(assembly, found, bodies, axes)


@pytest.mark.parametrize("way", WAYS)
def test_it_is_the_mirror_image(way, tmp_path):
    """Masses, faces, joints with their play and what they face are those of a part that is drawn mirrored."""
    one = imported(two_arms(WAYS[way], drawn=False), tmp_path / "instance.step")
    other = imported(two_arms(WAYS[way], drawn=True), tmp_path / "drawn.step")
    assert [part.placement.mirrored for part in one.assembly.parts] == [False, False, True]
    assert not any(part.placement.mirrored for part in other.assembly.parts)
    for (mass, centre, inertia), (mass_drawn, centre_drawn, inertia_drawn) in zip(
        one.bodies, other.bodies, strict=True
    ):
        assert mass == pytest.approx(mass_drawn, rel=1e-9)
        np.testing.assert_allclose(centre, centre_drawn, atol=1e-8)
        np.testing.assert_allclose(inertia, inertia_drawn, atol=1e-7 * np.abs(inertia_drawn).max())
    for ours, drawn in zip(one.found.joints, other.found.joints, strict=True):
        assert (ours.pin.journal, ours.pin.bearing) == (drawn.pin.journal, drawn.pin.bearing)
        assert ours.pin.radial_clearance == pytest.approx(BORE - PIN, abs=1e-9)
        assert len(ours.flanges) == len(drawn.flanges) > 0
        assert [flange.play for flange in ours.flanges] == pytest.approx(
            [each.play for each in drawn.flanges], abs=1e-9
        )
    assert [joint.pin.bearing for joint in one.found.joints] == ["arm-1", "arm-2"]
    for (point, axis), (point_drawn, axis_drawn) in zip(one.axes, other.axes, strict=True):
        np.testing.assert_allclose(point, point_drawn, atol=1e-8)
        np.testing.assert_allclose(np.abs(axis @ axis_drawn), 1.0, atol=1e-9)
    for end, (x, y) in zip(
        one.axes[::2], AT.values() if one.axes[0][0][0] < 0 else list(AT.values())[::-1], strict=True
    ):
        np.testing.assert_allclose(end[0][:2], [x, y], atol=1e-8)
    assert one.found.refused == other.found.refused == ()
    assert len(one.found.stops) == len(other.found.stops)
    for ours, drawn in zip(one.found.stops, other.found.stops, strict=True):
        assert ours.pair.gap == pytest.approx(drawn.pair.gap, abs=1e-9)
        np.testing.assert_allclose(ours.pair.middle, drawn.pair.middle, atol=1e-8)


def test_a_mirror_in_a_mirror_is_none(tmp_path):
    """A mirrored subassembly with a mirrored part in it: that one is as drawn, the other is mirrored, in its place."""
    made = Drawing()
    top, pair = made.assembly("top"), made.assembly("pair")
    product = made.product("arm", arm(), STEEL)
    made.add(pair, product, shifted(x=20.0), "plain")
    made.add(pair, product, shifted(x=20.0).Multiplied(mirror((0.0, 1.0, 0.0))), "mirrored")
    made.add(top, pair, shifted(z=30.0).Multiplied(mirror()), "other side")
    assembly = read_assembly(made.write(tmp_path / "twice.step"), "0" * 64, 1e-4)
    alone = Drawing()
    alone.product("arm", arm(), STEEL)
    [drawn] = read_assembly(alone.write(tmp_path / "alone.step"), "0" * 64, 1e-4).parts
    plain, twice = assembly.parts
    assert (plain.placement.mirrored, twice.placement.mirrored) == (True, False)
    centre, inertia = drawn.solids[0].centre, drawn.solids[0].inertia
    for part, signs in ((plain, [-1, 1, 1]), (twice, [-1, -1, 1])):
        np.testing.assert_allclose(part.solids[0].centre, signs * centre + [-20.0, 0.0, 30.0], atol=1e-9)
        np.testing.assert_allclose(part.solids[0].inertia, np.outer(signs, signs) * inertia, atol=1e-6)
        assert part.solids[0].volume == pytest.approx(drawn.solids[0].volume, rel=1e-12)
        holes = [face for face in assembly.faces_of(part.name) if face.hollow and face.kind == "cylinder"]
        assert [face.radius for face in holes] == [BORE]
        np.testing.assert_allclose(holes[0].point, [-20.0, 0.0, 30.0 + HIGH / 2], atol=1e-9)
