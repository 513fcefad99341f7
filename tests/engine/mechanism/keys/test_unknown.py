"""A key that does not exist is answered with what stands where it goes wrong, and the key that is meant."""

from engine.mechanism import load_mechanism, mechanism_from
from engine.mechanism.keys.values import meant_key, unknown_key
from tests.each import each
from tests.engine.mechanism.plain import pendulum

C60 = load_mechanism("c60")


@each(
    ("key", "meant"),
    [
        ("joints.J2.bearing.point.0", "joints.J2.bearing.point.x"),
        ("joints.J2.bearing.pont.z", "joints.J2.bearing.point.z"),
        ("joint.J2.radial_clearnce", "joints.J2.radial_clearance"),
        ("J2.bearing.point.x", "joints.J2.bearing.point.x"),
        ("A3.preload", "springs.A3.preload"),
        ("springs.A3.prelaod", "springs.A3.preload"),
        ("bodies.handle.center_of_mas.y", "bodies.handle.center_of_mass.y"),
        ("bodies.handle.centre_of_mass.y", "bodies.handle.center_of_mass.y"),
        ("bodies.handle.inertia.0", "bodies.handle.inertia.xx"),
        ("bodies.handle.inertia.zx", "bodies.handle.inertia.xz"),
        ("preload", "springs.handle_spring.preload"),
        ("samples", ""),
        ("J9", ""),
        ("springs.A9.preload", ""),
        ("", ""),
        ("....", ""),
    ],
)
def test_the_key_that_is_meant(key, meant):
    """Table by table, and in the same table: never a number of another kind whose letters are alike."""
    assert meant_key(C60, key) == meant


def test_the_message_names_what_is_there():
    """Below the part of the key that exists."""
    mechanism = mechanism_from(pendulum(), "FILE")
    said = unknown_key(mechanism, "joints.J1.bearing.q")
    assert said == "unknown key; joints.J1.bearing has body, point, axis, deviation, diameter, lobes"
    assert "springs has pull, turn; did you mean 'springs.pull.stiffness'?" in unknown_key(
        mechanism, "springs.pul.stiffness"
    )
    assert "as clearcap mechanism show --keys lists them" in unknown_key(mechanism, "nothing")
