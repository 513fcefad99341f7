"""Gaps at the start, computed in two ways: by the functions used in a run, and by OCCT between the faces as drawn."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from engine.errors import EngineError
from engine.faults.fault import some
from engine.mechanism import Mechanism
from engine.mechanism.geometry.cad_table import DrawnGap, DrawnJoint, GeometryCertificate
from engine.mechanism.geometry.face_search import length
from engine.preflight.plausibility import Caution

AGREE = 1e-5
"""Largest difference [mm] between the two gaps, beyond the errors of recognising and converting the faces."""

_ENDS = 1e-6  # share of a joint's length by which a ring at its end may lie beyond it


def with_start_gaps(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose certificate of geometry contains its gaps at the start next to the distances as drawn.

    A mechanism that takes nothing from a CAD file, or that cannot start, is returned unchanged.
    """
    certificate = mechanism.geometry
    if certificate is None or not certificate.gaps:
        return mechanism
    variants = {"": mechanism}
    for name in mechanism.benches:
        if any(key.startswith(f"benches.{name}.") for key in certificate.gaps):
            variants[f"benches.{name}."] = mechanism.on_bench(name)
    gaps = dict(certificate.gaps)
    for prefix, variant in variants.items():
        tables = f"{prefix}joints", f"{prefix}contacts"
        own = {key: gap for key, gap in gaps.items() if key.rpartition(".")[0] in tables}
        gaps |= _compared(variant, certificate, own)
    completed = certificate.model_copy(update={"gaps": gaps})
    return mechanism.with_tables({"geometry": completed}, mechanism.formulas)


def _compared(
    mechanism: Mechanism, certificate: GeometryCertificate, gaps: Mapping[str, DrawnGap]
) -> dict[str, DrawnGap]:
    """Return the gaps completed with those at the start of a run; unchanged if the mechanism cannot start."""
    from engine.assembly import assemble

    try:
        assembly = assemble(mechanism)
    except EngineError:
        return dict(gaps)
    if assembly.travel or any(mechanism.stretch(body) != 1.0 for body in mechanism.bodies):
        # its gaps are not those of the drawing
        return dict(gaps)
    millimetre = _millimetre(mechanism)
    at_start = dict(zip(assembly.contact_names, assembly.state.gap.tolist(), strict=True))
    compared = {}
    for key, gap in gaps.items():
        name = key.rpartition(".")[2]
        if key.endswith(f"contacts.{name}"):
            start, added = at_start[name], -mechanism.contacts[name].offset
        else:
            start, added = _of_joint(mechanism.joints[name], certificate.joints[name], name, at_start)
        numbers = {"gap": length(start, millimetre), "added": length(added, millimetre)}
        compared[key] = gap.model_copy(update=numbers) if np.isfinite(start) else gap
    return compared


def _of_joint(joint: Any, drawn: DrawnJoint, name: str, at_start: Mapping[str, float]) -> tuple[float, float]:
    """Return the smallest gap of the rings in the overlap of pin and hole, and what the file adds to their clearance.

    The gap is infinite if no ring is there.
    """
    reach = (0.5 + _ENDS) * (drawn.length or 0.0)
    within = [i for i, station in enumerate(joint.rings or (), 1) if abs(station) <= reach]
    smallest = min((at_start[f"{name}.ring{i}"] for i in within), default=np.inf)
    return smallest, joint.play("ring1") - drawn.clearance


def start_gap_cautions(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield cautions about gaps from `with_start_gaps` that differ from those OCCT measures between the faces."""
    certificate, unit = mechanism.geometry, mechanism.unit("length")
    if certificate is None:
        return
    if certificate.unreadable:
        yield Caution(
            "cad.file",
            None,
            "1",
            f"{certificate.file} is damaged, and what {certificate.unreadable} of its entities describe of "
            f"{some(certificate.damaged)} is left out",
            "",
            "export it again",
        )
    if certificate.not_measured:
        yield Caution(
            "geometry",
            None,
            "1",
            f"no gap was compared with the CAD file ({certificate.not_measured})",
            "",
            "see there",
        )
    for key, gap in certificate.gaps.items():
        faces = [face for where, face in certificate.faces.items() if where.startswith(f"{key}.")]
        allowed = AGREE * _millimetre(mechanism) + sum(face.recognition_gap for face in faces)
        allowed += max((face.conversion_error or 0.0 for face in faces), default=0.0)
        if gap.difference is None or abs(gap.difference) <= allowed:
            continue
        added = f", to which this file adds {gap.added:.6g} {unit}" if gap.added else ""
        yield Caution(
            key,
            gap.gap,
            unit,
            f"a run starts from this gap, and the CAD file draws the faces {gap.drawn:.9g} {unit} apart{added}",
            f"a difference of up to {allowed:.2g} {unit}",
            _remedy(key),
        )


def _millimetre(mechanism: Mechanism) -> float:
    """Return the length of a millimetre in a mechanism's unit of length."""
    return 1.0 if mechanism.units == "mm-g-ms" else 1e-3


def _remedy(key: str) -> str:
    """Return what the user should look at."""
    if ".joints." in f".{key}":
        return "look whether points, axes and rings that this file gives lie where hole and pin do"
    return (
        "look whether the place where they are nearest lies on both faces: for a run a plane is endless and an edge"
        " ends only where its arc does"
    )
