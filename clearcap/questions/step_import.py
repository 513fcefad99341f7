"""From a STEP file to a mechanism file: a first proposal, a later revision of the STEP file, and drafts in a store.

What is proposed is handed to a writer file by file, as soon as it is known, so that a slow question at the end costs
nothing of what was found before.
"""

import os
from collections.abc import Callable
from contextlib import chdir
from dataclasses import asdict, dataclass, replace
from difflib import unified_diff
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from campaign.errors import SpecError
from campaign.spec.campaign_file import proposed_campaign
from campaign.store import Store, open_store
from campaign.store.drawing_library import Draft, read_draft, read_step, save_draft, save_page, save_step
from campaign.store.files.retry_policy import QUICK
from clearcap.questions.mechanisms import geometry_lines, mechanism_summary, mechanism_warnings
from engine import load_mechanism
from engine.cad import RECOGNITION, CadAssembly
from engine.cad import read_step as read_assembly
from engine.cad_import.drawn_tolerances import Diameter, Zone, all_diameters, all_zones
from engine.cad_import.found_features import found_features
from engine.cad_import.found_geometry import FoundGeometry, find_geometry
from engine.cad_import.proposed_groups import groups_of_bodies, listed_groups
from engine.cad_import.proposed_mechanism import proposed_mechanism, unloaded_directions
from engine.cad_import.proposed_text import OpenQuestion, open_questions
from engine.cad_import.updated_proposal import (
    UpdatedProposal,
    earlier_revision,
    named_as_before,
    named_as_written,
    renamed_parts,
    revised_groups,
    updated_proposal,
)
from engine.errors import Fault
from engine.faults.toml_positions import with_positions
from engine.mechanism.faults import sub_table
from engine.mechanism.models import refused
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml, text_bytes

Write = Callable[[Path, str | bytes], None]


@dataclass(frozen=True)
class Proposal:
    """What was found in a STEP file, what its mechanism file asks, and the files that were written."""

    found: FoundGeometry
    questions: list[OpenQuestion]
    written: list[Path]


@dataclass(frozen=True)
class Revision:
    """What a new STEP file changes in a mechanism file and in the campaign file of its limits."""

    diff: list[str]  # of all files
    renamed: list[str]
    kept: list[str]
    gone: list[str]
    added: list[str]
    questions: int  # that are open in all files
    written: list[Path]


def propose(
    step_file: str,
    output: Path,
    write: Write,
    recognition: float | None = None,
    *,
    pictures: bool = True,
    accept_damage: bool = False,
) -> Proposal:
    """Propose a mechanism file, the campaign file of its limits of size, a drawing, and a page in 3D."""
    asked = RECOGNITION if recognition is None else recognition
    found = find_geometry(assembly_in_step(step_file, asked, accept_damage=accept_damage))
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in output.stem).strip("-_")
    name = name if name[:1].isalpha() else f"mechanism-{name}".rstrip("-")
    file = os.path.relpath(step_file, output.parent)
    text, written = proposed_mechanism(found, file, name), [output]
    if any(varied := _varied(found)):
        write(campaign_file(output), proposed_campaign(*varied, output.name, f"{name}-limits"))
        written.append(campaign_file(output))
    write(output, text)
    drawing = _draw(found, text, step_file, output, write) if pictures else None
    # only now, because it may take long: the text above is the mechanism in which motions are sought that no load acts
    # on, and the second one asks about them
    text = proposed_mechanism(found, file, name, unloaded_directions(found, text))
    write(output, text)
    if drawing is not None:
        _draw_page(found, text, step_file, output, drawing, write)
        written += picture_files(output)
    return Proposal(found, open_questions(text), written)


def revise(
    path: Path,
    step_file: str,
    write: Write,
    recognition: float | None = None,
    *,
    pictures: bool = False,
    accept_damage: bool = False,
) -> Revision:
    """Bring a mechanism file, and the campaign file of its limits, to a new STEP file, and keep what its owner wrote.

    `recognition` is the largest distance of a spline from the plane or cylinder it is recognized as [mm]; None keeps
    that of the mechanism file.
    """
    earlier = earlier_revision(path)
    written_for, listed = groups_of_bodies(earlier.text), listed_groups(earlier.text)
    before = named_as_written(find_geometry(earlier.assembly, written_for), earlier.text)
    asked = earlier.assembly.recognition if recognition is None else recognition
    assembly = assembly_in_step(step_file, asked, accept_damage=accept_damage)
    groups = revised_groups(listed or [], earlier.assembly, assembly)
    found = named_as_before(find_geometry(assembly, groups), before)
    proposed = (
        proposed_mechanism(before, earlier.file, earlier.name, listed=listed or []),
        proposed_mechanism(found, os.path.relpath(step_file, path.parent), earlier.name, listed=groups),
    )
    files = {path: (earlier.text, updated_proposal(earlier.text, *proposed))} | _campaign_texts(path, before, found)
    diff: list[str] = []
    written = []
    for file, (text, updated) in files.items():
        lines = text.splitlines(), updated.text.splitlines()
        if changes := list(unified_diff(*lines, str(file), str(file), lineterm="", n=1)):
            write(file, updated.text)
            written.append(file)
            diff += changes
    if pictures:
        _draw(found, files[path][1].text, step_file, path, write)
        written += picture_files(path)
    renamed = [f"{old} is now {new}; body {body} stays" for body, old, new in renamed_parts(found, before)]
    updates = [updated for _, updated in files.values()]
    kept, gone, added = ([x for each in updates for x in getattr(each, key)] for key in ("kept", "gone", "added"))
    questions = sum(len(open_questions(each.text)) for each in updates)
    return Revision(diff, renamed, kept, gone, added, questions, written)


def assembly_in_step(step_file: str, recognition: float, *, accept_damage: bool) -> CadAssembly:
    """Read a STEP file; SpecError if it yields no mechanism, or if it is damaged."""
    assembly = read_assembly(step_file, recognition)
    if assembly.damage and not accept_damage:
        raise SpecError(f"{step_file}: {assembly.damage}, or take what is left with --accept-damage")
    if (parts := len(assembly.parts)) < 2:
        raise SpecError(
            f"{step_file}: holds {'one part' if parts else 'no parts'}; allowed: two or more, one of them fixed; export"
            " the assembly, not a single part"
        )
    return assembly


def campaign_file(mechanism: Path) -> Path:
    """Return the campaign file of the limits of size beside a mechanism file."""
    return mechanism.with_name(f"{mechanism.stem}-campaign.toml")


def picture_files(mechanism: Path) -> list[Path]:
    """Return the files of the drawing and of the page beside a mechanism file."""
    return [mechanism.with_suffix(".svg"), mechanism.with_suffix(".html")]


def _draw(found: FoundGeometry, text: str, step_file: str, mechanism: Path, write: Write) -> bytes:
    """Write the drawing of the found geometry, and its page; return the drawing."""
    from clearcap.import_page import sketch_found
    from clearcap.pictures.sketch import plot_sketch
    from clearcap.pictures.style import as_bytes

    places = found_features(found)
    said = "; ".join(place.text for place in places)
    title = f"{Path(step_file).name}: what was found"
    drawing = as_bytes("svg", lambda path: plot_sketch(sketch_found(found, places), title, said, path))
    write(picture_files(mechanism)[0], drawing)
    _draw_page(found, text, step_file, mechanism, drawing, write)
    return drawing


def _draw_page(found: FoundGeometry, text: str, step_file: str, mechanism: Path, drawing: bytes, write: Write) -> None:
    """Write the page of the found geometry, with the questions of a mechanism file."""
    from clearcap.import_page import ImportFiles, import_page

    files = ImportFiles(Path(step_file).name, mechanism.name, drawing)
    write(picture_files(mechanism)[1], import_page(found, found_features(found), text, files))


def _campaign_texts(
    mechanism: Path, before: FoundGeometry, found: FoundGeometry
) -> dict[Path, tuple[str, UpdatedProposal]]:
    """Return the campaign file of the limits with its old and its new text; empty if neither revision has limits."""
    path, name = campaign_file(mechanism), f"{mechanism.stem}-limits"
    varied = _varied(before), _varied(found)
    old, new = (proposed_campaign(*each, mechanism.name, name) for each in varied)
    if path.exists() and any(varied[0]):
        text = read_regular_file(path, LARGEST).decode("utf-8-sig")
        return {path: (text, updated_proposal(text, old, new))}
    return {path: ("", UpdatedProposal(new))} if any(varied[1]) and not path.exists() and not any(varied[0]) else {}


def _varied(found: FoundGeometry) -> tuple[list[Diameter], list[Zone]]:
    """Return the diameters and the zones in a CAD file that a campaign varies."""
    return all_diameters(found), all_zones(found)


# -- drafts in a store -------------------------------------------------------------------------------------------------


def import_into_store(store: str, draft: Draft, step: Path | None, accept_damage: bool = False) -> dict[str, Any]:
    """Save a STEP file, the draft of a mechanism that is proposed from it, and its page in 3D; return ``changes``.

    Of the new draft, name, STEP file's name and author are given. An earlier one of this name is brought to the new
    file, or without one to the groups in its text, and keeps what its authors wrote; ``changes`` tells what happened to
    it. Nothing is saved of a file that yields no mechanism. For a process of its own: the current folder is another
    meanwhile.
    """
    opened, files = open_store(store, QUICK), dict[Path, str | bytes]()
    content = read_step(opened, draft.step) if step is None else step.read_bytes()
    before = read_draft(opened, draft.name)
    draft = replace(draft, step=sha256(content).hexdigest(), version=before.version if before else 0)
    output, changes = Path(f"{draft.name}.toml"), dict[str, Any]()
    with TemporaryDirectory(prefix="clearcap-") as folder, chdir(folder):  # so that no text names the folder
        if before is not None:
            _unpack(opened, before, output)
            files = {output: before.text, campaign_file(output): before.campaign}
        Path(draft.step_file).write_bytes(content)
        if before is None:
            propose(draft.step_file, output, files.__setitem__, accept_damage=accept_damage)
        else:
            revision = revise(output, draft.step_file, files.__setitem__, pictures=True, accept_damage=accept_damage)
            changes = {key: value for key, value in asdict(revision).items() if key != "written"}
    save_step(opened, content)
    text, campaign = (_bytes(files.get(each, b"")).decode() for each in (output, campaign_file(output)))
    save_draft(opened, replace(draft, text=text, campaign=campaign))
    save_page(opened, draft.name, _bytes(files[picture_files(output)[1]]))
    return {"changes": changes}


def check_draft(store: str, draft: Draft) -> dict[str, Any]:
    """Return a draft's summary, warnings, geometry and open questions, and the ``text`` of its plain numbers.

    Raises MechanismError if it has faults. For a process of its own, as `import_into_store`.
    """
    opened, file = open_store(store, QUICK), Path(f"{draft.name}.toml")
    with TemporaryDirectory(prefix="clearcap-") as folder, chdir(folder):
        _unpack(opened, draft, file)
        loaded = load_mechanism(file)
    found = {"summary": mechanism_summary(loaded), "warnings": mechanism_warnings(loaded)}
    asked = [asdict(each) for each in open_questions(draft.text)]
    return {**found, "geometry": geometry_lines(loaded), "questions": asked, "text": loaded.to_toml()}


def _unpack(store: Store, draft: Draft, mechanism: Path) -> None:
    """Write the files of a draft; raise MechanismError if its text names another CAD file, which would be opened."""
    content = text_bytes(draft.text)
    try:
        cad = sub_table(parse_toml(content), "cad")
    except UnfitToml:  # whoever reads the file says where
        cad = {}
    for key, own in (("file", draft.step_file), ("sha256", draft.step)):
        if cad.get(key, own) != own:
            text = f"not the STEP file of this draft; allowed: {own!r}; upload another revision in its place"
            fault = Fault(("cad", key), text, cad[key])
            raise refused(str(mechanism), list(with_positions([fault], content)), 1)
    Path(draft.step_file).write_bytes(read_step(store, draft.step))
    mechanism.write_bytes(content)
    if draft.campaign:
        campaign_file(mechanism).write_text(draft.campaign, "utf-8")


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content
