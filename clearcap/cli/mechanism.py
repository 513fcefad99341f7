"""``clearcap mechanism``: list, show and check mechanisms, write them with plain numbers; ``clearcap schema``."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from clearcap.cli.import_step import import_step
from clearcap.cli.options import named_mechanism
from clearcap.cli.output import Json, print_json, print_text, say

mechanism_app = typer.Typer(help="List, show and check mechanisms.", no_args_is_help=True)
mechanism_app.command("import")(import_step)

MechanismName = Annotated[str, typer.Argument(help="A shipped mechanism or a mechanism file.")]


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
    from campaign.errors import SpecError
    from clearcap.questions.mechanisms import mechanism_summary
    from engine.mechanism import settable_keys

    if pattern and not keys:
        raise SpecError(f"{pattern}: a filter needs --keys; add --keys, or leave the filter out")
    loaded = named_mechanism(mechanism)
    loaded = loaded.on_bench(bench) if bench else loaded
    if picture:
        _draw(loaded, picture)
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
    moving = _counted(document["moving_bodies"], "moving body", "moving bodies")
    parts = (moving, _counted(document["joints"], "joint"), _counted(document["contacts"], "contact"))
    print_text(f"\nunits {document['units']}; {', '.join(parts)} besides those of joints\n", lines=True)
    if document["parameters"]:
        print_text("parameters:")
    for name, entry in document["parameters"].items():
        print_text(f"  {name} = {entry['value']:g} {entry['unit']}")
    if document["clearances"]:
        print_text("clearances:")
    for name, entry in document["clearances"].items():
        print_text(f"  {name} = {entry['value']:g} {entry['unit']}")
    print_text("responses:")
    for name, entry in document["responses"].items():
        unit = "" if entry["unit"] == "1" else f" [{entry['unit']}]"
        print_text(f"  {name}{unit}  {entry['title']}")
    for condition in document["validity"]:
        print_text(f"valid only if {condition}")
    print_text(f"{len(settable_keys(loaded))} numbers can be set: --keys lists them")
    for kind in ("benches", "presets"):
        for name, title in document[kind].items():
            print_text(f"--{kind.removesuffix('es' if kind == 'benches' else 's')} {name}  {title}")


@mechanism_app.command()
def check(mechanism: MechanismName, json: Json = False) -> None:
    """Check a mechanism, also on its test benches and with its presets; warn of what looks wrong but can run."""
    from clearcap.questions.mechanisms import converted_surfaces, geometry_lines, mechanism_warnings
    from engine.cad_import.proposed_text import questions_of_file
    from engine.preflight.start_gaps import with_start_gaps

    questions = questions_of_file(mechanism)
    for question in () if json else questions:
        print_text(f"question: {mechanism}, line {question.line}: {question.text}")
    loaded = with_start_gaps(named_mechanism(mechanism))
    warnings, surfaces = mechanism_warnings(loaded), converted_surfaces(loaded)
    if json:
        document = {"mechanism": loaded.name, "ok": True, "digest": loaded.digest(), "warnings": warnings}
        document["questions"] = [asdict(question) for question in questions]
        document["geometry"] = loaded.geometry.model_dump(exclude_none=True) if loaded.geometry else None
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
    count = f", {_counted(len(warnings), 'warning')}" if warnings else ""
    count += f", {_counted(len(questions), 'open question')}" if questions else ""
    print_text(f"{mechanism}: no errors{count}")


@mechanism_app.command()
def plain(
    mechanism: MechanismName,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write it to a file: .toml.")] = None,
    json: Json = False,
) -> None:
    """Write a mechanism with plain numbers in the place of the geometry that it takes from a CAD file."""
    from clearcap.cli.output_files import check_output, replacing
    from engine.cad_import.proposed_text import questions_of_file

    loaded = named_mechanism(mechanism)
    for question in questions_of_file(mechanism):  # the written file has no questions
        say(f"question: {mechanism}, line {question.line}: {question.text}")
    if output is not None:
        check_output("--output", output, (".toml",))
        with replacing(output) as temporary:
            temporary.write_text(loaded.to_toml(), "utf-8")
        if not json:
            return
    if json:
        print_json(loaded.to_dict())
    else:
        print_text(loaded.to_toml().rstrip("\n"), lines=True)


def _print_keys(mechanism: Any, pattern: str, json: bool) -> None:
    """Print the settable numbers with value, unit, limits and meaning."""
    from campaign.errors import SpecError
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
        notes = [
            f"= {entry.expression}" if entry.expression else "",
            f"also called {entry.short}" if entry.short else "",
            entry.limits,
            entry.description,
            "" if entry.varies else "not by variables of a campaign",
        ]
        print_text(f"{entry.key:{width}}  {entry.value:.10g}{unit}  {'; '.join(filter(None, notes))}")


def _draw(mechanism: Any, picture: Path) -> None:
    """Draw the mechanism at its start with what its responses measure."""
    from clearcap.cli.output_files import PLOTS, check_output, replacing
    from clearcap.pictures.sketches.sketch import plot_measurements

    check_output("--picture", picture, PLOTS)
    with replacing(picture) as temporary:
        plot_measurements(mechanism, temporary)


def _counted(count: int, one: str, many: str = "") -> str:
    """Return a count with its noun in singular or plural."""
    return f"{count} {one if count == 1 else many or one + 's'}"


schema_app = typer.Typer(help="Print the JSON Schema of a file format.", no_args_is_help=True)


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
    from reporting.render.json import report_schema

    print_json(report_schema())
