"""``clearcap mechanism import --update``: a new revision of a STEP file."""

import os
from difflib import unified_diff
from pathlib import Path
from typing import TYPE_CHECKING

from campaign.cli.output import print_json, print_text

if TYPE_CHECKING:
    from engine.cad_import.found_geometry import FoundGeometry
    from engine.cad_import.updated_proposal import UpdatedProposal


def bring_to_revision(
    path: Path, step_file: str, recognition: float | None, *, accept_damage: bool, pictures: bool, json: bool
) -> None:
    """Update a mechanism file, and the campaign file of its limits, to a new STEP file, and print the changes.

    `recognition` is the largest distance of a spline from the plane or cylinder it is recognized as [mm]; None keeps
    that of the mechanism file. `accept_damage` uses the readable part of a damaged file, `pictures` draws both pictures
    anew.
    """
    from campaign.cli.importing.found_in_step import draw_found, found_in_step, picture_files
    from campaign.cli.output_files import check_output, replacing
    from engine.cad_import.found_geometry import find_geometry
    from engine.cad_import.names_of_before import named_as_before, named_as_written, renamed_parts
    from engine.cad_import.proposed_mechanism import proposed_mechanism
    from engine.cad_import.proposed_text import open_questions
    from engine.cad_import.updated_proposal import earlier_revision, updated_proposal

    check_output("--update", path, (".toml",))
    earlier = earlier_revision(path)
    before = named_as_written(find_geometry(earlier.assembly), earlier.text)
    asked = earlier.assembly.recognition if recognition is None else recognition
    found = named_as_before(found_in_step(step_file, asked, accept_damage=accept_damage), before)
    proposed = (
        proposed_mechanism(before, earlier.file, earlier.name),
        proposed_mechanism(found, os.path.relpath(step_file, path.parent), earlier.name),
    )
    files = {path: (earlier.text, updated_proposal(earlier.text, *proposed))} | _campaign(path, before, found)
    changes = {file: _changes(file, *each) for file, each in files.items()}
    for file, (_, updated) in files.items():
        if changes[file]:
            with replacing(file) as temporary:
                temporary.write_text(updated.text, "utf-8")
    drawn = picture_files(path) if pictures else []
    if drawn:
        draw_found(found, files[path][1].text, step_file, path)
    written = [str(each) for each in (*(file for file in files if changes[file]), *drawn)]
    renamed = [f"{old} is now {new}; body {body} stays" for body, old, new in renamed_parts(found, before)]
    said = {key: [x for _, u in files.values() for x in getattr(u, key)] for key in ("kept", "gone", "added")}
    if json:
        print_json(
            {
                "changes": [line for lines in changes.values() for line in lines],
                "renamed": renamed,
                **said,
                "written": written,
            }
        )
        return
    for line in (line for lines in changes.values() for line in lines):
        print_text(line)
    for text in renamed:
        print_text(f"renamed in the STEP file: {text}")
    for text in said["kept"]:
        print_text(f"kept as you wrote it: {text}")
    for table in said["gone"]:
        print_text(f"no longer in the STEP file: {table}; remove it, or name other faces")
    if not any(changes.values()):
        print_text(f"{path}: nothing has changed")
    count = sum(len(open_questions(updated.text)) for _, updated in files.values())
    open_now = f"{count} {'question is' if count == 1 else 'questions are'} open"
    if written:
        print_text(f"written: {', '.join(written)}{f'; {open_now}' if count and any(changes.values()) else ''}")


def _campaign(
    mechanism: Path, before: "FoundGeometry", found: "FoundGeometry"
) -> dict[Path, tuple[str, "UpdatedProposal"]]:
    """Return the campaign file of the limits with its old and its new text; empty if neither revision has limits."""
    from campaign.spec.proposed_campaign import proposed_campaign
    from engine.cad_import.proposed_joints import all_diameters
    from engine.cad_import.updated_proposal import UpdatedProposal, updated_proposal
    from engine.platform.regular_file import read_regular_file
    from engine.platform.toml_file import LARGEST

    path, name = campaign_file(mechanism), f"{mechanism.stem}-limits"
    diameters = all_diameters(before), all_diameters(found)
    old, new = (proposed_campaign(each, mechanism.name, name) for each in diameters)
    if path.exists() and diameters[0]:
        text = read_regular_file(path, LARGEST).decode("utf-8-sig")
        return {path: (text, updated_proposal(text, old, new))}
    return {path: ("", UpdatedProposal(new))} if diameters[1] and not path.exists() and not diameters[0] else {}


def campaign_file(mechanism: Path) -> Path:
    """Return the campaign file of the limits of size beside a mechanism file."""
    return mechanism.with_name(f"{mechanism.stem}-campaign.toml")


def _changes(path: Path, text: str, updated: "UpdatedProposal") -> list[str]:
    """Return the changes of a file as a diff."""
    return list(unified_diff(text.splitlines(), updated.text.splitlines(), str(path), str(path), lineterm="", n=1))
