"""Questions about one mechanism: its contents, what looks wrong in it, one simulation, its pictures, its journals."""

import pickle
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from math import inf
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from campaign.compiling import compile_engine
from campaign.errors import CampaignError, SpecError
from engine import (
    Recording,
    Run,
    check,
    load_mechanism,
    load_mechanism_text,
    missing_kernels,
    read_trajectory,
    set_values,
    simulate,
)
from engine.mechanism import Mechanism, get_value, library_names, unit_of
from engine.mechanism.geometry.cad_table import DrawnBody, DrawnFace, DrawnGap, GeometryCertificate
from engine.mechanism.keys.values import settable_numbers
from engine.mechanism.meshes.certificate import MeshCertificate
from engine.mechanism.quantities import Quantity
from engine.mechanism.surfaces.surface import FreeFormSurface
from engine.platform.child import Child, ChildEnded, Limits, Send
from engine.platform.toml_file import UnfitToml, parse_toml, text_bytes
from engine.preflight import cautions

if TYPE_CHECKING:
    from campaign.spec.load import Campaign
    from clearcap.pictures.play import JournalPositions

PICTURES = ("svg", "png")
ANIMATION_FRAMES = 45  # half the frames of the command line, so that the animation is ready within seconds
MOST_STEPS = 2000  # steps that are recorded of a run that a page draws
ENDS = 10**9  # recording interval: only the first and the last row of a trajectory are kept


def mechanism_summary(mechanism: Mechanism) -> dict[str, Any]:
    """Return the contents of a mechanism: inputs with value and unit, responses, validity conditions."""
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
        "parameters": {n: {"value": x, "unit": mechanism.parameter_units[n]} for n, x in mechanism.parameters.items()},
        "clearances": {
            name: {"value": get_value(mechanism, name), "unit": unit_of(mechanism, name)}
            for name in mechanism.loose_joints()
        },
        "responses": {
            n: {"title": each.title, "type": each.type, "unit": units[n]} for n, each in mechanism.responses.items()
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
    return {n: {"patches": len(x.top), "error": x.conversion_error, "unit": unit} for n, x in splines.items()}


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
    """Return one line for each mesh, for the CAD file, and for each body, joint, face and gap from it."""
    certificate = mechanism.geometry
    length, mass = mechanism.unit("length"), mechanism.unit("mass")
    meshes = [f"{key}: {_mesh(mesh, length)}" for key, mesh in mechanism.meshes.items()]
    if certificate is None:
        return meshes
    return [
        *meshes,
        f"geometry from {certificate.file}, sha256 {certificate.sha256[:12]}",
        *(f"  {key}: {_body(body, length, mass)}" for key, body in certificate.bodies.items()),
        *(
            f"  joints.{name}: clearance {joint.clearance:.6g} {length} as drawn, axes {joint.axis_offset:.3g} {length}"
            f" apart and {joint.tilt:.3g} rad tilted"
            for name, joint in certificate.joints.items()
        ),
        *(f"  {key}: {_face(face, length)}" for key, face in certificate.faces.items()),
        *(f"  {key}: {_gap(gap, length)}" for key, gap in certificate.gaps.items()),
    ]


def _mesh(mesh: MeshCertificate, length: str) -> str:
    """Return the certificate of a mesh in words."""
    pieces = "1 convex piece" if mesh.pieces == 1 else f"{mesh.pieces} convex pieces"
    return (
        f"{pieces} with {mesh.corners} corners for the {mesh.triangles} triangles of {mesh.file}, sha256"
        f" {mesh.sha256[:12]}; the mesh is at most {mesh.mesh_to_pieces:.3g} {length} from the surface of the pieces,"
        f" which is at most {mesh.pieces_to_mesh:.3g} {length} from the mesh; allowed {mesh.allowed:.3g} {length}"
    )


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
    found = {key: abs(gap.difference) for key, gap in certificate.gaps.items() if gap.difference is not None}
    gaps = f"none compared with the CAD file ({certificate.not_measured or 'no two faces that face each other'})"
    if found:  # how well they agree with the distances that OCCT measures
        worst = max(found, key=found.__getitem__)
        gaps = f"{len(found)} compared with OCCT's distances, largest difference {found[worst]:.3g} ({worst})"
    return {
        "CAD file": f"{certificate.file}{damage}",
        "sha256 of the CAD file": certificate.sha256,
        "geometry from it": f"{len(certificate.bodies)} bodies, {len(faces)} faces; largest recognition gap {gap:.3g}"
        f"{converted}, axes up to {offset:.3g} apart and {tilt:.3g} rad tilted as drawn",
        "gaps at the start": gaps,
    }


def _body(body: DrawnBody, length: str, mass: str) -> str:
    text = f"part {body.part}, {body.volume:.6g} {length}3"
    if body.drawn_mass is None:
        return text
    drawn = f"{body.drawn_mass:.6g} {mass} by the density of {body.density_from}"
    if body.mass is None:
        return f"{text}, {drawn}"
    return f"{text}, {body.mass:.6g} {mass} in this file, {100 * (body.mass / body.drawn_mass - 1):+.2g} % from {drawn}"


def _face(face: DrawnFace, length: str) -> str:
    radius = "" if face.radius is None else f" of radius {face.radius:.9g} {length}"
    error = "" if face.conversion_error is None else f", conversion error {face.conversion_error:.3g} {length}"
    return f"{face.kind}{radius}, recognition gap {face.recognition_gap:.3g} {length}{error}"


def _gap(gap: DrawnGap, length: str) -> str:
    added = f", {gap.added:+.6g} {length} by this file" if gap.added else ""
    start = f", gap at the start {gap.gap:.6g} {length}" if gap.gap is not None else ""
    start += f", difference {gap.difference:.2g} {length}" if start else ""
    return f"{gap.drawn:.6g} {length} apart as OCCT measures{added}{start}"


@dataclass(frozen=True)
class MechanismSource:
    """The mechanism of a job."""

    name: str  # of a shipped mechanism, or for the text in messages
    text: str | None = None  # content of its file; None for a shipped one
    bench: str | None = None  # one of its test benches
    preset: str | None = None  # one of its sets of values
    values: Mapping[str, float] = field(default_factory=dict)  # by key; they override those of the preset

    def load(self) -> Mechanism:
        """Return the mechanism on its bench, without applying preset and values."""
        if self.text is None and self.name not in library_names():
            raise SpecError(f"mechanism {self.name!r:.100}: none of this name; shipped: {', '.join(library_names())}")
        loaded = load_mechanism(self.name) if self.text is None else load_mechanism_text(self.text, self.name)
        return loaded.on_bench(self.bench) if self.bench else loaded

    def all_values(self, mechanism: Mechanism) -> dict[str, float]:
        """Return the values of the preset, overridden by `values`."""
        return (dict(mechanism.preset(self.preset)) if self.preset else {}) | dict(self.values)


def describe(source: MechanismSource) -> dict[str, Any]:
    """Return the summary of a mechanism and every number that can be set, with value, unit and limits."""
    mechanism = source.load()
    values = source.all_values(mechanism)
    mechanism = set_values(mechanism, values) if values else mechanism
    return {**mechanism_summary(mechanism), "keys": [asdict(entry) for entry in settable_numbers(mechanism, "")]}


def titles(sources: Sequence[MechanismSource]) -> dict[str, str]:
    """Return the title of each mechanism by name, from its text alone; empty if the text has none or is not TOML."""
    found = {}
    for source in sources:
        try:
            title = parse_toml(text_bytes(source.text or "")).get("title", "")
        except UnfitToml:
            title = ""
        found[source.name] = title if isinstance(title, str) else ""
    return found


def check_text(source: MechanismSource) -> dict[str, Any]:
    """Return the summary and the warnings of a mechanism's text; raise MechanismError if it has faults."""
    mechanism = source.load()
    return {"summary": mechanism_summary(mechanism), "warnings": mechanism_warnings(mechanism)}


def values_of(settings: Iterable[str]) -> dict[str, float]:
    """Return the values of ``KEY=VALUE`` texts by key; raise SpecError for another text, or a key that comes twice."""
    values: dict[str, float] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        try:
            number = float(text)
        except ValueError:
            equals = ""
        if not equals or not key.strip():
            raise SpecError(f"--set {setting:.100}: not KEY=VALUE with a number; write for example --set J1=0.05")
        if key.strip() in values:
            raise SpecError(f"--set {setting:.100}: {key} is set twice; keep one of them")
        values[key.strip()] = number
    return values


def simulate_once(source: MechanismSource, step: float | None = None, horizon: float | None = None) -> dict[str, Any]:
    """Simulate a mechanism and return its `run_document`."""
    mechanism = source.load()
    run = simulate(mechanism, source.all_values(mechanism), step=step, horizon=horizon, indeterminacy=True)
    return run_document(run)


def run_document(run: Run) -> dict[str, Any]:
    """Return a run as ``clearcap simulate --json`` and the web service write it."""
    results = {"status": run.status, "message": run.message, "responses": run.measured, "units": run.units}
    return {**results, "ranges": run.ranges, "remarks": run.remarks, "certificate": asdict(run.certificate)}


def try_once(source: MechanismSource) -> dict[str, Any]:
    """Simulate a mechanism; return the result of `simulate_once` as ``run`` and its `MovingDrawing` as ``motion``."""
    from clearcap.pictures.moving_drawing import moving_drawing
    from clearcap.pictures.scene import scene_of

    results = simulate_once(source)
    every = max(1, results["certificate"]["steps"] // MOST_STEPS)
    mechanism = source.load()
    with TemporaryDirectory(prefix="clearcap-") as folder:
        motion = Path(folder, "motion.h5")
        simulate(mechanism, source.all_values(mechanism), trajectory=Recording(motion, every))
        trajectory = read_trajectory(motion)
    return {"run": results, "motion": asdict(moving_drawing(scene_of(trajectory, ANIMATION_FRAMES)))}


def warm_up_try_out() -> None:
    """Compile or load all code that a try-out run of a mechanism calls, which includes that of every run."""
    try_once(MechanismSource("c60"))


def engine_is_compiled() -> bool:
    """Return whether `warm_up_try_out` will only load compiled code."""
    return not missing_kernels()


def animate_once(source: MechanismSource, step: float | None = None, horizon: float | None = None) -> bytes:
    """Simulate a mechanism and return its motion as a GIF."""
    from clearcap.pictures.animation import animate
    from clearcap.pictures.style import as_bytes

    mechanism = source.load()
    with TemporaryDirectory(prefix="clearcap-") as folder:
        motion = Path(folder, "motion.h5")
        simulate(mechanism, source.all_values(mechanism), step=step, horizon=horizon, trajectory=motion)
        return as_bytes("gif", lambda path: animate(read_trajectory(motion), path, ANIMATION_FRAMES))


def draw_mechanism(source: MechanismSource, kind: str = "svg") -> bytes:
    """Return a picture, ``svg`` or ``png``, of a mechanism at its start, with what its responses measure."""
    from clearcap.pictures.sketch import plot_measurements
    from clearcap.pictures.style import as_bytes

    if kind not in PICTURES:
        raise SpecError(f"picture {kind!r:.20}: allowed: {', '.join(PICTURES)}")
    mechanism = source.load()
    mechanism = set_values(mechanism, source.all_values(mechanism))
    return as_bytes(kind, lambda path: plot_measurements(mechanism, path))


def campaign_journal_positions(campaign: "Campaign", processes: int) -> "list[JournalPositions]":
    """Simulate a campaign of few samples; return the journals' positions, by ring, at the ends of successful runs."""
    from campaign.inputs.sampling import draw
    from clearcap.pictures.play import merge_runs

    spec = campaign.spec
    drawn, targets = draw(spec, 0, spec.samples), spec.targets()
    values = [{targets[name]: float(x[i]) for name, x in drawn.items()} for i in range(spec.samples)]
    fixed = (campaign.mechanism, spec.simulation.step, spec.simulation.horizon)
    compile_engine()  # once, for all processes
    free: SimpleQueue[Child] = SimpleQueue()

    def positions(x: dict[str, float]) -> "list[JournalPositions]":
        child = free.get()
        try:
            found: list[JournalPositions] = pickle.loads(child.answer(pickle.dumps((*fixed, x)), Limits(), inf))
            return found
        finally:
            free.put(child)

    with ThreadPoolExecutor(processes) as threads, ExitStack() as children:  # which end first, so that no thread waits
        for _ in range(min(processes, spec.samples)):
            free.put(children.enter_context(Child(f"{__name__}:{positions_at_end.__name__}")))
        try:
            return merge_runs(list(filter(None, threads.map(positions, values))))
        except ChildEnded as error:
            raise CampaignError(f"a process that simulates ended ({error}); repeat it with fewer --workers") from error


def positions_at_end(request: bytes, _send: Send) -> bytes:
    """Simulate once in a child; return the positions of the journals at the end, pickled, empty if the run failed."""
    from clearcap.pictures.play import journal_positions

    mechanism, step, horizon, values = pickle.loads(request)
    with TemporaryDirectory(prefix="clearcap-") as folder:
        path = Path(folder) / "end.h5"
        run = simulate(mechanism, values, step=step, horizon=horizon, trajectory=Recording(path, ENDS))
        return pickle.dumps(journal_positions(read_trajectory(path)) if run.status == "ok" else [])
