"""Rings with clearances and places of their own, and bores and pins of arcs against distances by brute force."""

from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine import simulate
from engine.assembly import assemble
from engine.errors import MechanismError
from engine.kernels.contact_geometry.gaps import find_contacts
from engine.mechanism import set_values
from tests.engine.small import made, place, small

Z = [0.0, 0.0, 1.0]
RADIUS, PLAY = 1.0, 0.05


def ring(bore: Any = None, pin: Any = None, **joint: Any) -> dict[str, Any]:
    """Describe a disc with one ring, or more, about a pin of the ground, whose overlap at the start is let pass."""
    line = {"point": [0, 0, 0], "axis": Z}
    sides = {
        "bearing": {"body": "part", **line, **({"lobes": bore} if bore else {})},
        "journal": {"body": "ground", **line, "radius": RADIUS, **({"lobes": pin} if pin else {})},
    }
    plain = {"type": "clearance_cylindrical", **sides, "rings": [0.0], "radial_clearance": PLAY, "friction": 0.1}
    return small(
        bodies={"ground": {"fixed": True}, "part": {"mass": 1.0, "inertia": [1, 1, 1]}},
        joints={"J": {**plain, **joint}},
        simulation={"penetration": 1e3},
    )


def test_each_ring_has_its_clearance_and_its_place():
    """A tapered bore whose far wall is drilled 0.03 to the side."""
    data = ring(rings=[-1.0, 2.0], taper=[0.0, 0.02], ring_offsets=[[0, 0, 0], [0.03, 0, 0]])
    assert assemble(made(data)).state.gap == pytest.approx([PLAY, PLAY + 0.02 - 0.03], abs=1e-15)
    changed = set_values(made(data), {"joints.J.taper.1": 0.01, "joints.J.ring_offsets.1.1": 0.04, "J": 0.07})
    assert assemble(changed).state.gap == pytest.approx([0.07, 0.07 + 0.01 - 0.05], abs=1e-15)
    with pytest.raises(MechanismError, match=r"taper.*1 entries for 2 rings"):
        made(ring(rings=[-1.0, 2.0], taper=[0.0]))
    with pytest.raises(MechanismError, match=r"no play; allowed: 0 < radial_clearance \+ taper"):
        made(ring(taper=[-0.06]))
    dump = made(ring()).model_dump(mode="json", by_alias=True)["joints"]["J"]
    assert not {"taper", "ring_offsets", "lobes"} & (dump.keys() | dump["bearing"].keys() | dump["journal"].keys())


def discs(lobes: Any, sign: float) -> np.ndarray:
    """Return the centres of the discs that make a bore (-1) or a pin (1); one for a round one."""
    if lobes is None:
        return np.zeros((1, 2))
    n, phase = lobes["number"], lobes.get("phase", 0.0)
    off = sign * lobes["height"] / (1 - cos(pi / n))
    return np.array([[off * cos(phase + 2 * pi * i / n), off * sin(phase + 2 * pi * i / n)] for i in range(n)])


def wall(lobes: Any, samples: int) -> np.ndarray:
    """Return points of a bore's wall: along each ray from its axis, the first circle that is met."""
    way = np.linspace(0, 2 * pi, samples, endpoint=False)
    rays, centres = np.stack([np.cos(way), np.sin(way)], axis=1), discs(lobes, -1.0)
    radius = RADIUS + PLAY + np.hypot(*centres[0])
    along = rays @ centres.T
    reach = along + np.sqrt(radius**2 - np.sum(centres**2, axis=1) + along**2)
    return rays * reach.min(axis=1)[:, None]


def brute(points: np.ndarray, lobes: Any) -> np.ndarray:
    """Return the least distance of points, (..., m, 2), from a pin: the convex hull of its discs; < 0 inside."""
    centres = discs(lobes, 1.0)
    radius = RADIUS - np.hypot(*centres[0])
    ends = np.roll(centres, -1, axis=0)
    least = np.full(points.shape[:-1], np.inf)
    for a, b in zip(centres, ends, strict=True):  # the core is a point, a segment or a polygon within the pin
        way = b - a
        share = np.clip(((points - a) @ way) / max(way @ way, 1e-300), 0, 1)[..., None]
        least = np.minimum(least, np.linalg.norm(points - a - share * way, axis=-1))
    return least.min(axis=-1) - radius


def test_the_point_of_a_contact_lies_on_its_lobe():
    """It is the arm of friction about the axis."""
    lobes = {"number": 3, "height": 0.01, "phase": -0.4}
    assembly = assemble(made(ring(None, lobes)))
    place(assembly, 0, [0.02, 0.01, 0.0], Rotation.identity())
    gap, sites = np.zeros(len(assembly.contact_names)), assembly.work.sites
    find_contacts(assembly.model.contacts, assembly.state.x, assembly.state.R, gap, sites.point, sites.frame)
    centres = discs(lobes, 1.0)
    arms = np.linalg.norm(sites.point[: len(gap), :2] - centres, axis=1)
    assert arms == pytest.approx(RADIUS - np.hypot(*centres[0]), abs=1e-12)


FORMS: list[tuple[Any, Any]] = [
    ({"number": 2, "height": 0.02, "phase": 0.3}, None),
    ({"number": 3, "height": 0.005}, None),
    (None, {"number": 3, "height": 0.01, "phase": -0.4}),
    ({"number": 2, "height": 0.01}, {"number": 5, "height": 0.004, "phase": 1.0}),
]


@pytest.mark.parametrize(("bore", "pin"), FORMS)
@pytest.mark.parametrize("poses", [300, pytest.param(10_000, marks=pytest.mark.slow)])
def test_arcs_and_lobes_against_brute_force(bore, pin, poses):
    """The least gap is the distance of the walls where they are free of each other, and negative where they are not.

    It changes by no more than the features move: 1-Lipschitz.
    """
    rng = np.random.default_rng(poses)
    assembly = assemble(made(ring(bore, pin)))
    model, work = assembly.model, assembly.work
    shape = wall(bore, 4000)
    found = np.zeros(poses)
    shifts, turns = rng.uniform(-0.08, 0.08, (poses, 2)), rng.uniform(-pi, pi, poses)
    true = np.zeros(poses)
    gap = np.zeros(len(assembly.contact_names))

    def least(shift: np.ndarray, turn: float) -> float:
        place(assembly, 0, [*shift, rng.uniform(-0.1, 0.1)], Rotation.from_euler("z", turn))
        find_contacts(model.contacts, assembly.state.x, assembly.state.R, gap, work.sites.point, work.sites.frame)
        return float(gap.min())

    for i, (shift, turn) in enumerate(zip(shifts, turns, strict=True)):
        found[i] = least(shift, turn)
        turned = shape @ np.array([[cos(turn), sin(turn)], [-sin(turn), cos(turn)]]) + shift
        true[i] = brute(turned, pin)
        moved, turned_by = rng.normal(0, 1e-3, 2), rng.normal(0, 1e-3)
        outermost = RADIUS + PLAY + 0.1
        assert abs(least(shift + moved, turn + turned_by) - found[i]) <= np.hypot(*moved) + outermost * abs(turned_by)
    free = found > 1e-6
    assert 0.1 < free.mean() < 0.95
    np.testing.assert_allclose(found[free], true[free], atol=2e-6)
    assert (true[~free] < 3e-6).all()


def test_the_height_is_the_deviation_from_roundness():
    """The wall's largest less smallest radius; the play is smallest at the phase, and twice the height more across."""
    for lobes in (form for pair in FORMS for form in pair[:1] if form):
        radii = np.linalg.norm(wall(lobes, 40_000), axis=1)
        assert radii.max() - radii.min() == pytest.approx(lobes["height"], rel=0.05)
        assert radii.min() == pytest.approx(RADIUS + PLAY, abs=1e-6)


def test_a_disc_hangs_in_the_narrow_or_the_wide_of_an_oval():
    """At rest the bore is below the pin by its play along gravity: c at the phase, sqrt(c^2 + 2 c d) across it."""
    for phase, drop in ((pi / 2, PLAY), (0.0, np.sqrt(PLAY**2 + 2 * PLAY * 0.02))):
        data = ring({"number": 2, "height": 0.02, "phase": phase}, None, rings=[-1.0, 1.0])
        data |= {"gravity": [0, -9.81, 0], "phases": [{"name": "hang", "damping": 30.0}]}
        data["simulation"] |= {"penetration": 1e-9, "horizon": 20.0}
        from_, to = {"body": "part", "point": [0, 0, 0]}, {"body": "ground", "point": [0, 0, 0]}
        y = {"type": "position", "from": from_, "to": to, "direction": {"vector": [0, 1, 0]}}
        run = simulate(made(data | {"responses": {"drop": y}}))
        assert run.status == "ok", run.message
        assert run.responses["drop"] == pytest.approx(drop, rel=1e-4)
