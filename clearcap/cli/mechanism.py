"""``clearcap mechanism``: import from STEP files, list, show, check, write plain numbers; ``clearcap schema``."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.errors import SpecError
from campaign.waits import counted
from clearcap.cli.help_pages import Group
from clearcap.cli.options import named_mechanism
from clearcap.cli.output import Json, labelled, print_json, print_text, say
from clearcap.output_files import PLOTS, check_output, replacing

if TYPE_CHECKING:
    from engine.cad_import.found_geometry import FoundGeometry

mechanism_app = typer.Typer(cls=Group, help="List, show and check mechanisms.", no_args_is_help=True)
MechanismName = Annotated[str, typer.Argument(help="A shipped mechanism or a mechanism file.")]


@mechanism_app.command("import")
def import_step(
    step_file: Annotated[str, typer.Argument(metavar="STEP", help="A STEP file: .step or .stp.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The mechanism file to write: .toml.")] = None,
    update: Annotated[
        Path | None,
        typer.Option(help="A mechanism file of an earlier revision: show what changed, and keep what you wrote."),
    ] = None,
    recognition: Annotated[
        float | None,
        typer.Option(
            help="How far a spline may be from the plane or cylinder it is taken for, in mm; default: 1e-4, with"
            " --update that of the mechanism file.",
            show_default=False,
        ),
    ] = None,
    pictures: Annotated[
        bool | None,
        typer.Option(
            help="Draw what was found beside the mechanism file, as .svg and in 3D as .html; by default with --output,"
            " with --update only on request, in place of earlier ones.",
            show_default=False,
        ),
    ] = None,
    accept_damage: Annotated[
        bool, typer.Option("--accept-damage", help="Take what can be read of a damaged STEP file.")
    ] = False,
    json: Json = False,
) -> None:
    """Propose a mechanism file from a STEP file: parts, joints, play, and questions about what it does not say."""
    from clearcap.questions.step_import import campaign_file, picture_files, propose

    if (output is None) == (update is None):
        raise SpecError("one of --output and --update is needed; name the mechanism file that is to be written")
    if update is not None:
        with_pictures = pictures is True
        _update(update, step_file, recognition, accept_damage=accept_damage, pictures=with_pictures, json=json)
        return
    assert output is not None
    campaign = campaign_file(output)
    check_output("--output", output, (".toml",))
    _refuse_existing(output, "may hold answers")
    for each in [] if pictures is False else picture_files(output):
        _refuse_existing(each, "import draws into it; leave the pictures out with --no-pictures")

    def write(path: Path, content: str | bytes) -> None:
        if path == campaign:  # the first file, if there is one
            _refuse_existing(path, "may hold answers")
        _write(path, content)

    with_pictures = pictures is not False
    proposal = propose(step_file, output, write, recognition, pictures=with_pictures, accept_damage=accept_damage)
    written = [str(each) for each in proposal.written]
    if json:
        asked = [each.text for each in proposal.questions]
        print_json({**_document(proposal.found), "questions": asked, "written": written})
        return
    _print_found(proposal.found)
    for question in proposal.questions:
        print_text(f"question, line {question.line}: {question.text}")
    print_text(f"written: {', '.join(written)}; {len(proposal.questions)} questions are open")


def _update(
    path: Path, step_file: str, recognition: float | None, *, accept_damage: bool, pictures: bool, json: bool
) -> None:
    """Update a mechanism file to a new STEP file, see `clearcap.questions.step_import.revise`; print the changes."""
    from clearcap.questions.step_import import revise

    check_output("--update", path, (".toml",))
    found = revise(path, step_file, _write, recognition, accept_damage=accept_damage, pictures=pictures)
    written = [str(each) for each in found.written]
    if json:
        said = {"kept": found.kept, "gone": found.gone, "added": found.added}
        print_json({"changes": found.diff, "renamed": found.renamed, **said, "written": written})
        return
    for line in found.diff:
        print_text(line)
    for text in found.renamed:
        print_text(f"renamed in the STEP file: {text}")
    for text in found.kept:
        print_text(f"kept as you wrote it: {text}")
    for table in found.gone:
        print_text(f"no longer in the STEP file: {table}; remove it, or name other faces")
    if not found.diff:
        print_text(f"{path}: nothing has changed")
    open_now = f"{found.questions} {'question is' if found.questions == 1 else 'questions are'} open"
    if written:
        print_text(f"written: {', '.join(written)}{f'; {open_now}' if found.questions and found.diff else ''}")


@mechanism_app.command("list")
def list_mechanisms(json: Json = False) -> None:
    """List the shipped mechanisms."""
    from engine import library_names, load_mechanism

    titles = {name: load_mechanism(name).title for name in library_names()}
    if json:
        print_json([{"name": name, "title": title} for name, title in titles.items()])
        return
    width = max(map(len, titles))
    for name, title in titles.items():
        print_text(f"{name:{width}}  {title}")


@mechanism_app.command()
def show(
    mechanism: MechanismName,
    pattern: Annotated[
        str,
        typer.Argument(
            metavar="[FILTER]", help="With --keys: a part of the keys to list, or a pattern with *, ? or [...]."
        ),
    ] = "",
    keys: Annotated[
        bool, typer.Option("--keys", help="List every number that can be set: key, value, unit, limits, meaning.")
    ] = False,
    bench: Annotated[str | None, typer.Option(help="Show the mechanism on one of its test benches.")] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the mechanism and what its responses measure: .png, .svg or .pdf.")
    ] = None,
    json: Json = False,
) -> None:
    """Show the content of a mechanism: inputs with value and unit, responses, validity conditions."""
    from clearcap.questions.mechanisms import mechanism_summary
    from engine.mechanism import settable_keys

    if pattern and not keys:
        raise SpecError(f"{pattern}: a filter needs --keys; add --keys, or leave the filter out")
    loaded = named_mechanism(mechanism)
    loaded = loaded.on_bench(bench) if bench else loaded
    if picture:
        from clearcap.pictures.sketch import plot_measurements

        check_output("--picture", picture, PLOTS)
        with replacing(picture) as temporary:
            plot_measurements(loaded, temporary)
        say(f"picture: {picture}")
    if keys:
        _print_keys(loaded, pattern, json)
        return
    document = mechanism_summary(loaded)
    if json:
        print_json(document)
        return
    print_text(f"{document['name']}: {document['title']}")
    if document["description"]:
        print_text(document["description"], lines=True)
    moving = document["moving_bodies"]
    parts = f"{moving} moving bod{'y' if moving == 1 else 'ies'}, {counted(document['joints'], 'joint')}"
    parts += f", {counted(document['contacts'], 'contact')} besides those of joints"
    print_text(f"\nunits {document['units']}; {parts}\n", lines=True)
    for kind in ("parameters", "clearances"):
        if document[kind]:
            print_text(f"{kind}:")
        for name, entry in document[kind].items():
            print_text(f"  {name} = {entry['value']:g} {entry['unit']}")
    print_text("responses:")
    for name, entry in document["responses"].items():
        print_text(f"  {labelled(name, entry['unit'])}  {entry['title']}")
    for condition in document["validity"]:
        print_text(f"valid only if {condition}")
    print_text(f"{len(settable_keys(loaded))} numbers can be set: --keys lists them")
    for kind, option in (("benches", "bench"), ("presets", "preset")):
        for name, title in document[kind].items():
            print_text(f"--{option} {name}  {title}")


@mechanism_app.command()
def check(mechanism: MechanismName, json: Json = False) -> None:
    """Check a mechanism, also on its test benches and with its presets; warn of what looks wrong but can run."""
    from clearcap.questions.mechanisms import converted_surfaces, geometry_lines, mechanism_warnings
    from engine.cad_import.proposed_text import questions_of_file
    from engine.preflight.cautions import with_start_gaps

    questions = questions_of_file(mechanism)
    for question in () if json else questions:
        print_text(f"question: {mechanism}, line {question.line}: {question.text}")
    loaded = with_start_gaps(named_mechanism(mechanism))
    warnings, surfaces = mechanism_warnings(loaded), converted_surfaces(loaded)
    if json:
        document = {"mechanism": loaded.name, "ok": True, "digest": loaded.digest(), "warnings": warnings}
        document["questions"] = [asdict(question) for question in questions]
        document["geometry"] = loaded.geometry.model_dump(exclude_none=True) if loaded.geometry else None
        document["meshes"] = {key: mesh.model_dump() for key, mesh in loaded.meshes.items()}
        document["surfaces"] = surfaces
        print_json(document)
        return
    for line in geometry_lines(loaded):
        print_text(line)
    for name, entry in surfaces.items():
        error = f"{entry['error']:.2g} {entry['unit']}"
        print_text(f"contacts.{name}: {entry['patches']} bicubic patches, no farther than {error} from the B-spline")
    for entry in warnings:
        print_text(f"warning: {mechanism}: {entry['where']}{': ' if entry['where'] else ''}{entry['text']}")
    count = f", {counted(len(warnings), 'warning')}" if warnings else ""
    count += f", {counted(len(questions), 'open question')}" if questions else ""
    print_text(f"{mechanism}: no errors{count}")


@mechanism_app.command()
def plain(
    mechanism: MechanismName,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write it to a file: .toml.")] = None,
    json: Json = False,
) -> None:
    """Write a mechanism with plain numbers in the place of the geometry that it takes from files."""
    from engine.cad_import.proposed_text import questions_of_file

    loaded = named_mechanism(mechanism)
    for question in questions_of_file(mechanism):  # the written file has no questions
        say(f"question: {mechanism}, line {question.line}: {question.text}")
    if output is not None:
        check_output("--output", output, (".toml",))
        _write(output, loaded.to_toml())
        if not json:
            return
    if json:
        print_json(loaded.to_dict())
    else:
        print_text(loaded.to_toml().rstrip("\n"), lines=True)


def _print_keys(mechanism: Any, pattern: str, json: bool) -> None:
    """Print the settable numbers with value, unit, limits and meaning."""
    from engine.mechanism.keys.values import meant_key, settable_numbers

    entries = settable_numbers(mechanism, pattern)
    if not entries:
        meant = meant_key(mechanism, pattern)
        question = f"; did you mean '{meant}'?" if meant else ""
        raise SpecError(f"{pattern}: no key of {mechanism.name} contains this; leave it out to list all{question}")
    if json:
        print_json([asdict(entry) for entry in entries])
        return
    width = max(len(entry.key) for entry in entries)
    for entry in entries:
        unit = "" if entry.unit == "1" else f" {entry.unit}"
        origin = f"= {entry.expression}" if entry.expression else ""
        short = f"also called {entry.short}" if entry.short else ""
        fixed = "" if entry.varies else "not by variables of a campaign"
        notes = (origin, short, entry.limits, entry.description, fixed)
        print_text(f"{entry.key:{width}}  {entry.value:.10g}{unit}  {'; '.join(filter(None, notes))}")


def _write(path: Path, content: str | bytes) -> None:
    with replacing(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


schema_app = typer.Typer(cls=Group, help="Print the JSON Schema of a file format.", no_args_is_help=True)


@schema_app.command()
def mechanism(json: Json = False) -> None:
    """Print the JSON Schema of mechanism files."""
    from engine.mechanism import mechanism_schema

    print_json(mechanism_schema())


@schema_app.command()
def campaign(json: Json = False) -> None:
    """Print the JSON Schema of campaign files."""
    from campaign.spec.campaign_file import campaign_schema

    print_json(campaign_schema())


@schema_app.command()
def report(json: Json = False) -> None:
    """Print the JSON Schema of a report's capability.json."""
    from reporting.render.data_files import report_schema

    print_json(report_schema())


def _refuse_existing(path: Path, why: str) -> None:
    if path.exists():
        raise SpecError(f"{path}: exists already, and {why}; name another file with --output, or move it")


def _document(found: "FoundGeometry") -> dict[str, Any]:
    """Return the found geometry as plain data; lengths in mm."""
    from engine.cad_import.drawn_tolerances import unused_tolerances
    from engine.cad_import.found_features import pivot_text

    face = {f.number: f for f in found.assembly.faces}
    return {
        "parts": [
            {
                "name": part.name,
                "body": found.bodies.get(found.whole(part.name)),
                "path": list(part.path),
                "volume": sum(solid.volume for solid in part.solids),
                "material": part.material.name if part.material else None,
            }
            for part in found.drawn.parts
        ],
        "standard": [{"part": each.part, "kind": each.kind, "by": each.said} for each in found.standard],
        "springs": [{"name": each.name, "part": each.part, "ends": list(each.ends)} for each in found.springs],
        "groups": [
            {"body": found.bodies[group.name], "parts": list(group.parts), "why": group.why} for group in found.groups
        ],
        "joints": [
            {
                "name": joint.name,
                "bearing": joint.pin.bearing,
                "journal": joint.pin.journal,
                "hole_radius": joint.pin.seats[0].hole_radius,
                "pin_radius": joint.pin.seats[0].pin_radius,
                "radial_clearance": joint.pin.radial_clearance,
                "axial_plays": {flange.side: flange.play for flange in joint.flanges},
                "point": joint.pin.point.tolist(),
                "axis": joint.pin.axis.tolist(),
            }
            for joint in found.joints
        ],
        "balls": [
            {
                "name": each.name,
                "socket": each.ball.socket_part,
                "ball": each.ball.ball_part,
                "socket_radius": each.ball.socket_radius,
                "ball_radius": each.ball.ball_radius,
                "radial_clearance": each.ball.radial_clearance,
                "centre": each.ball.centre.tolist(),
            }
            for each in found.balls
        ],
        "stops": [
            {
                "name": stop.name,
                "parts": list(stop.pair.parts),
                "kinds": [face[number].kind for number in stop.pair.faces],
                "gap": stop.pair.gap,
                "area": getattr(stop.pair, "area", None),
            }
            for stop in found.stops
        ],
        "pivots": [{"name": each.name, "text": pivot_text(found, each)} for each in found.pivots],
        "refused": [
            {"hole_of": face[miss.hole].part, "pin_of": face[miss.pin].part, "reason": miss.reason}
            for miss in found.refused
        ],
        "left_out": list(found.assembly.cautions),
        "not_used": unused_tolerances(found),
    }


def _print_found(found: "FoundGeometry") -> None:
    from engine.cad_import.found_features import (
        folded_features,
        folded_tolerances,
        found_features,
        group_text,
        part_text,
        pivot_text,
        spring_text,
        standard_texts,
    )

    listed = {each.part for each in found.standard}
    for text in (
        *(part_text(part) for part in found.drawn.parts if part.name not in listed),
        *standard_texts(found),
        *map(spring_text, found.springs),
        *(group_text(found, group) for group in found.groups),
        *folded_features(found, found_features(found)),
        *(pivot_text(found, pivot) for pivot in found.pivots),
        *(f"left out: {text}" for text in found.assembly.cautions),
        *folded_tolerances(found),
    ):
        print_text(text)
