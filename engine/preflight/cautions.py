"""All cautions about a mechanism, and one about a fixed step with which it does not come to rest.

Gaps at the start are computed in two ways: by the functions that a run uses, and by OCCT between the faces as drawn.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from engine.errors import EngineError, NotAssemblable, some
from engine.mechanism import Mechanism, set_values
from engine.mechanism.geometry.cad_table import DrawnGap, DrawnJoint, GeometryCertificate
from engine.mechanism.geometry.drawn_features import length
from engine.preflight.drawn_cautions import pressed_starts, time_cautions
from engine.preflight.plausibility import Caution, duplicates, fast_spins, implausible_numbers, stiff_springs
from engine.simulate import check as can_start
from engine.simulate import simulate

AGREE = 1e-5  # largest difference [mm] between the two gaps, beyond the errors of recognising and converting the faces
_ENDS = 1e-6  # share of a joint's length by which a ring at its end may lie beyond it


def with_start_gaps(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose certificate of geometry has its gaps at the start, if it can, beside those as drawn."""
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
        return dict(gaps)  # those of the run are not those of the drawing
    millimetre = _millimetre(mechanism)
    at_start = dict(zip(assembly.contact_names, assembly.state.gap.tolist(), strict=True))
    compared = {}
    for key, gap in gaps.items():
        name = key.rpartition(".")[2]
        if key.endswith(f"contacts.{name}"):
            start = min(float(assembly.state.gap[i]) for i in assembly.numbers(name))
            added = -mechanism.contacts[name].offset
        else:
            start, added = _of_joint(mechanism.joints[name], certificate.joints[name], name, at_start)
        numbers = {"gap": length(start, millimetre), "added": length(added, millimetre)}
        compared[key] = gap.model_copy(update=numbers) if np.isfinite(start) else gap
    return compared


def _of_joint(joint: Any, drawn: DrawnJoint, name: str, at_start: Mapping[str, float]) -> tuple[float, float]:
    """Return the smallest gap of the rings where pin and hole overlap, or inf, and what the file adds to their play."""
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
        text = f"{certificate.file} is damaged, and what {certificate.unreadable} of its entities describe of "
        yield Caution("cad.file", text=f"{text}{some(certificate.damaged)} is left out", remedy="export it again")
    if certificate.not_measured:
        text = f"no gap was compared with the CAD file ({certificate.not_measured})"
        yield Caution("geometry", text=text, remedy="see there")
    for key, gap in certificate.gaps.items():
        faces = [face for where, face in certificate.faces.items() if where.startswith(f"{key}.")]
        allowed = AGREE * _millimetre(mechanism) + sum(face.recognition_gap for face in faces)
        allowed += max((face.conversion_error or 0.0 for face in faces), default=0.0)
        if gap.difference is None or abs(gap.difference) <= allowed:
            continue
        added = f", to which this file adds {gap.added:.6g} {unit}" if gap.added else ""
        text = f"a run starts from this gap, and the CAD file draws the faces {gap.drawn:.9g} {unit} apart{added}"
        yield Caution(key, gap.gap, unit, text, f"a difference of up to {allowed:.2g} {unit}", _remedy(key))


def _millimetre(mechanism: Mechanism) -> float:
    """Return the length of a millimetre in a mechanism's unit of length."""
    return 1.0 if mechanism.units == "mm-g-ms" else 1e-3


def _remedy(key: str) -> str:
    """Return what the user should look at."""
    if ".joints." in f".{key}":
        return "look whether points, axes and rings that this file gives lie where hole and pin do"
    endless = "for a run a plane is endless and an edge ends only where its arc does"
    return f"look whether the place where they are nearest lies on both faces: {endless}"


# All cautions about a mechanism.


MOST_BODIES = 40  # in a mechanism whose small motions are examined; the time grows with the third power

HALVINGS = 4
UNSTEADY = ("not_at_rest", "diverged")  # how a run ends with a step that is too long
LONGEST_TRIAL = 10.0  # s


def check(mechanism: Mechanism, values: Mapping[str, float] | None = None) -> list[Caution]:
    """Check that a mechanism can start with the given values, and return what looks wrong although it can run.

    Parameters
    ----------
    mechanism : Mechanism
        The description, see `load_mechanism`; on a test bench, `Mechanism.on_bench`.
    values : mapping, optional
        Numbers to set in it, as for `simulate`.

    Returns
    -------
    list of Caution
        The warnings of ``clearcap mechanism check``: each has ``key``, ``value``, ``unit``, ``text``, ``customary`` and
        ``remedy``, and as a string is one sentence.

    Raises
    ------
    MechanismError
        If a value is not allowed; NotAssemblable, if parts overlap at the start pose or ideal joints are open, and no
        pose nearby puts that right.
    """
    mechanism = set_values(mechanism, values) if values else mechanism
    can_start(mechanism)
    return cautions(mechanism)


def cautions(mechanism: Mechanism) -> list[Caution]:
    """Return the cautions about a mechanism that `engine.check` accepts: numbers, then motions, in the file's order."""
    drawn = [
        *(*time_cautions(mechanism), *_as_assembled(mechanism), *start_gap_cautions(mechanism)),
        *(*duplicates(mechanism), *fast_spins(mechanism), *_closed_loops(mechanism)),
    ]
    numbers = [*implausible_numbers(mechanism), *stiff_springs(mechanism)]
    moving = sum(not body.fixed for body in mechanism.bodies.values())
    ends_at_rest = any(phase.duration is None and phase.until is None for phase in mechanism.phases)
    if numbers or not ends_at_rest or not 0 < moving <= MOST_BODIES:
        return [*numbers, *drawn]
    from engine.assembly import assemble
    from engine.preflight.motion_cautions import early_rest, undamped_modes, unloaded_cautions
    from engine.preflight.small_motions import small_motions

    small = small_motions(assemble(mechanism))
    return [
        *drawn,
        *early_rest(mechanism, small),
        *unloaded_cautions(mechanism, small),
        *undamped_modes(mechanism, small),
    ]


def _as_assembled(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield cautions about the start pose, one if the assembly step moves bodies from where they are drawn."""
    from engine.assembly import assemble

    assembly, unit = assemble(mechanism), mechanism.unit("length")
    yield from pressed_starts(mechanism, assembly)
    moved = assembly.travel
    if moved:
        places: list[str] = []
        as_drawn = {"simulation": mechanism.simulation.model_copy(update={"assembly_travel": 0.0})}
        try:
            assemble(mechanism.with_tables(as_drawn, mechanism.formulas))
        except NotAssemblable as drawn:
            _, *places = [line.partition(";")[0].strip() for line in str(drawn).splitlines()]
        text = f"as drawn, {some(places)}; runs start from the nearest pose where parts do not overlap and "
        text += f"ideal joints are closed, which moves a body by {moved:.4g} {unit}"
        remedy = "correct the poses, or let it be if the drawing is meant so; with 0 such a start is refused"
        limit = mechanism.simulation.assembly_travel
        yield Caution("simulation.assembly_travel", limit, unit, text, remedy=remedy)


def _closed_loops(mechanism: Mechanism) -> list[Caution]:
    """Return the cautions about closed loops of ideal joints."""
    if sum(joint.ideal for joint in mechanism.joints.values()) < 2:
        return []
    from engine.assembly import assemble
    from engine.preflight.motion_cautions import closed_loop_cautions

    return [*closed_loop_cautions(mechanism, assemble(mechanism))]


def step_caution(mechanism: Mechanism, step: float, horizon: float | None = None) -> Caution | None:
    """Return a caution, naming the longest suitable step, if a mechanism does not come to rest with a fixed step.

    Half the step, a quarter of it and so on are tried, one run each. If none comes to rest, the step is not to blame.
    """
    limit = min(LONGEST_TRIAL, mechanism.simulation.wall_limit)
    mechanism = set_values(mechanism, {"simulation.wall_limit": limit})
    unit, message = mechanism.unit("time"), ""
    for halvings in range(HALVINGS + 1):
        shorter = 0.5**halvings * step
        run = simulate(mechanism, step=shorter, horizon=horizon)
        if run.status not in UNSTEADY:
            break
        message = message or run.message
    if run.status != "ok" or not message:
        return None
    text, best = f"with this fixed step the mechanism does not come to rest ({message})", f"{shorter:g} {unit}"
    remedy = f"with {best} it does: the longest that was tried, half and half again"
    return Caution("simulation.step", step, unit, text, f"up to {best}", remedy)
