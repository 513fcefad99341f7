"""Round faces before faces of other parts, and the profiles of these parts."""

from math import atan2, tau

import numpy as np
import pytest

from engine.cad.findings.facing_planes import triangles_by_face
from engine.cad.findings.facing_rounds import facing_rounds
from tests.engine.cad import stops


def enclosed(pieces):
    """Return the area to the left of lines and arcs, by Green's theorem."""
    area = 0.0
    for piece in pieces:
        (x, y), (dx, dy) = piece.start, piece.end - piece.start
        if piece.centre is None:
            area += 0.5 * (x * dy - y * dx)
            continue
        begin, end = (atan2(*(at - piece.centre)[::-1]) for at in (piece.start, piece.end))
        turned = (end - begin) % tau if piece.left else -((begin - end) % tau)
        radius = np.linalg.norm(piece.start - piece.centre)
        area += 0.5 * (radius**2 * turned + piece.centre[0] * dy - piece.centre[1] * dx)
    return area


def test_profiles_go_round_their_part(read):
    """Of a block with a round notch and of cams: closed, and as large as the section that OCCT's volume says."""
    pairs = {name: stops.TRUE[name] for name in ("notch", "nose", "base", "flank")}
    assembly = read(stops.drawing({name: shapes for name, (shapes, *_) in pairs.items()}))
    found = facing_rounds(assembly, triangles_by_face(assembly))
    gaps = {pair.parts[0].removesuffix("-frame"): pair.gap for pair in found}
    assert gaps == pytest.approx({name: gap for name, (*_, gap) in pairs.items()})
    for pair in found:
        pieces = pair.profile.pieces
        for one, other in zip(pieces, (*pieces[1:], pieces[0]), strict=True):
            np.testing.assert_allclose(one.end, other.start, atol=1e-9)
        [solid] = assembly.part(pair.parts[0]).solids
        assert 2 * pair.profile.half_length == pytest.approx(stops.THICK)
        assert enclosed(pieces) == pytest.approx(solid.volume / stops.THICK, rel=1e-7)
