"""Find features of a mechanism in a CAD assembly: pins in holes, balls in sockets, flanges, possible stops."""

from engine.cad.findings.balls_in_sockets import BallInSocket, balls_in_sockets
from engine.cad.findings.extruded_profiles import ExtrudedProfile, extruded_profile
from engine.cad.findings.facing_planes import FacingPlanes, facing_planes, triangles_by_face
from engine.cad.findings.facing_rounds import FacingRound, facing_rounds
from engine.cad.findings.pins_in_holes import (
    NearMiss,
    PinInHole,
    Seat,
    coaxial_fits,
    pin_in_hole,
    pins_in_holes,
    pins_in_slots,
)
from engine.cad.findings.standard_parts import Coil, StandardPart, standard_parts
from engine.cad.findings.thrust_faces import ThrustFaces, thrust_faces
from engine.cad.findings.undrawn_pins import UndrawnPin, undrawn_pins

__all__ = [
    "BallInSocket",
    "Coil",
    "ExtrudedProfile",
    "FacingPlanes",
    "FacingRound",
    "NearMiss",
    "PinInHole",
    "Seat",
    "StandardPart",
    "ThrustFaces",
    "UndrawnPin",
    "balls_in_sockets",
    "coaxial_fits",
    "extruded_profile",
    "facing_planes",
    "facing_rounds",
    "pin_in_hole",
    "pins_in_holes",
    "pins_in_slots",
    "standard_parts",
    "thrust_faces",
    "triangles_by_face",
    "undrawn_pins",
]
