"""A summary of a mechanism, what looks wrong in it, and how it agrees with its CAD file, for terminal and pages."""

from typing import Any

from campaign.compiling import compile_engine
from engine import check, set_values
from engine.mechanism import Mechanism, get_value, unit_of
from engine.mechanism.geometry.cad_table import DrawnBody, DrawnFace, DrawnGap, DrawnJoint, GeometryCertificate
from engine.mechanism.quantities import Quantity
from engine.mechanism.surfaces.surface import FreeFormSurface
from engine.preflight import cautions


def mechanism_summary(mechanism: Mechanism) -> dict[str, Any]:
    """Return the contents of a mechanism: inputs with value and unit, responses, validity conditions.

    Keys: ``name``, ``title``, ``description``, ``units``, ``digest``; the numbers of ``bodies``, ``moving_bodies``,
    ``joints`` and ``contacts``; ``parameters`` and ``clearances`` by name, each with ``value`` and ``unit``;
    ``responses`` by name, each with ``title`` and ``unit``; ``validity``; titles of ``benches`` and ``presets``.
    """
    units = mechanism.response_units()
    return {
        "name": mechanism.name,
        "title": mechanism.title,
        "description": mechanism.description.strip(),
        "units": mechanism.units,
        "digest": mechanism.digest(),
        "bodies": len(mechanism.bodies),
        "moving_bodies": sum(not body.fixed for body in mechanism.bodies.values()),
        "joints": len(mechanism.joints),
        "contacts": len(mechanism.contacts),
        "parameters": {
            name: {"value": value, "unit": mechanism.parameter_units[name]}
            for name, value in mechanism.parameters.items()
        },
        "clearances": {
            name: {"value": get_value(mechanism, name), "unit": unit_of(mechanism, name)}
            for name in mechanism.loose_joints()
        },
        "responses": {
            name: {"title": response.title, "unit": units[name]} for name, response in mechanism.responses.items()
        },
        "validity": [str(condition) for condition in mechanism.validity],
        "benches": {name: bench.title for name, bench in mechanism.benches.items()},
        "presets": {name: preset.title for name, preset in mechanism.presets.items()},
    }


def converted_surfaces(mechanism: Mechanism) -> dict[str, dict[str, Any]]:
    """Return the number of ``patches`` for each contact with B-splines, the conversion ``error`` and its ``unit``."""
    found = {name: contact.sides[1].primitive for name, contact in mechanism.contacts.items()}
    splines = {name: shape for name, shape in found.items() if isinstance(shape, FreeFormSurface) and not shape.patches}
    unit = Quantity("length").unit(mechanism.units)
    return {
        name: {"patches": len(shape.top), "error": shape.conversion_error, "unit": unit}
        for name, shape in splines.items()
    }


def mechanism_warnings(mechanism: Mechanism) -> list[dict[str, Any]]:
    """Check the start of a mechanism, including on its test benches and with its presets; return what looks wrong.

    Each caution comes once, as plain data, with its ``text`` and with ``where``: the bench or preset, empty for
    neither. Raises EngineError if the mechanism cannot start, for example because parts overlap.
    """
    compile_engine()
    variants = {"": mechanism, **{f"bench {name}": mechanism.on_bench(name) for name in mechanism.benches}}
    variants |= {f"preset {name}": set_values(mechanism, mechanism.preset(name)) for name in mechanism.presets}
    warnings: dict[str, dict[str, Any]] = {}
    for where, variant in variants.items():
        check(variant)
        for caution in cautions(variant):
            warnings.setdefault(str(caution), {**caution.to_json(), "where": where, "text": str(caution)})
    return [*warnings.values()]


# -- the geometry certificate in words ---------------------------------------------------------------------------------


def geometry_lines(mechanism: Mechanism) -> list[str]:
    """Return one line for the CAD file and one for each body, joint, face and gap from it; empty without a CAD file."""
    certificate = mechanism.geometry
    if certificate is None:
        return []
    length, mass = mechanism.unit("length"), mechanism.unit("mass")
    return [
        f"geometry from {certificate.file}, sha256 {certificate.sha256[:12]}",
        *(f"  {key}: {_body(body, length, mass)}" for key, body in certificate.bodies.items()),
        *(f"  joints.{name}: {_joint(joint, length)}" for name, joint in certificate.joints.items()),
        *(f"  {key}: {_face(face, length)}" for key, face in certificate.faces.items()),
        *(f"  {key}: {_gap(gap, length)}" for key, gap in certificate.gaps.items()),
    ]


def geometry_provenance(certificate: GeometryCertificate | None) -> dict[str, str]:
    """Return what a report states about the CAD file: its name, its hash, and the largest deviations from it."""
    if certificate is None:
        return {}
    faces, joints = certificate.faces.values(), certificate.joints.values()
    gap = max((face.recognition_gap for face in faces), default=0.0)
    offset = max((joint.axis_offset for joint in joints), default=0.0)
    tilt = max((joint.tilt for joint in joints), default=0.0)
    errors = [face.conversion_error for face in faces if face.conversion_error is not None]
    converted = f", conversion error {max(errors):.3g}" if errors else ""
    damage = f", damaged: {certificate.unreadable} of its entities are left out" if certificate.unreadable else ""
    return {
        "CAD file": f"{certificate.file}{damage}",
        "sha256 of the CAD file": certificate.sha256,
        "geometry from it": f"{len(certificate.bodies)} bodies, {len(faces)} faces; largest recognition gap {gap:.3g}"
        f"{converted}, "
        f"axes up to {offset:.3g} apart and {tilt:.3g} rad tilted as drawn",
        "gaps at the start": _gaps(certificate),
    }


def _body(body: DrawnBody, length: str, mass: str) -> str:
    """Describe where a body's mass comes from."""
    text = f"part {body.part}, {body.volume:.6g} {length}3"
    if body.drawn_mass is None:
        return text
    drawn = f"{body.drawn_mass:.6g} {mass} by the density of {body.density_from}"
    if body.mass is None:
        return f"{text}, {drawn}"
    return f"{text}, {body.mass:.6g} {mass} in this file, {100 * (body.mass / body.drawn_mass - 1):+.2g} % from {drawn}"


def _joint(joint: DrawnJoint, length: str) -> str:
    return (
        f"clearance {joint.clearance:.6g} {length} as drawn, axes {joint.axis_offset:.3g} {length} apart and "
        f"{joint.tilt:.3g} rad tilted"
    )


def _face(face: DrawnFace, length: str) -> str:
    radius = "" if face.radius is None else f" of radius {face.radius:.9g} {length}"
    error = "" if face.conversion_error is None else f", conversion error {face.conversion_error:.3g} {length}"
    return f"{face.kind}{radius}, recognition gap {face.recognition_gap:.3g} {length}{error}"


def _gap(gap: DrawnGap, length: str) -> str:
    """Describe a gap by its value in the CAD file and its value at the start."""
    added = f", {gap.added:+.6g} {length} by this file" if gap.added else ""
    start = (
        ""
        if gap.gap is None
        else f", gap at the start {gap.gap:.6g} {length}, difference {gap.difference:.2g} {length}"
    )
    return f"{gap.drawn:.6g} {length} apart as OCCT measures{added}{start}"


def _gaps(certificate: GeometryCertificate) -> str:
    """Describe how well the gaps at the start agree with the distances that OCCT measures."""
    found = {key: abs(gap.difference) for key, gap in certificate.gaps.items() if gap.difference is not None}
    if not found:
        return f"none compared with the CAD file ({certificate.not_measured or 'no two faces that face each other'})"
    worst = max(found, key=found.__getitem__)
    return f"{len(found)} compared with OCCT's distances, largest difference {found[worst]:.3g} ({worst})"
