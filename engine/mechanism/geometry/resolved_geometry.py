"""Convert a mechanism file that names geometry of a CAD file to one with plain numbers and a certificate."""

from collections.abc import Mapping
from pathlib import Path
from shlex import quote
from typing import Any

from pydantic import ValidationError

from engine.cad import CadAssembly, in_unit, read_step
from engine.cad.cad_model import with_joined_parts
from engine.errors import CadError
from engine.faults.fault import Fault
from engine.mechanism.faults import as_table, faults_of, named_tables, sub_table
from engine.mechanism.geometry.cad_table import CadTable, GeometryCertificate
from engine.mechanism.geometry.drawn_tables import DrawnTables, drawn_gaps
from engine.mechanism.geometry.part_bodies import joined_name, parts_of_body
from engine.mechanism.quantities import UnitSystem


class UnresolvedGeometry(Exception):
    """The geometry named by a mechanism file cannot be found; ``faults`` lists what is wrong."""

    def __init__(self, faults: list[Fault]) -> None:
        super().__init__(f"{len(faults)} faults")
        self.faults = faults


def with_geometry(data: Mapping[str, Any], folder: Path, source: str) -> dict[str, Any]:
    """Return a mechanism file with the geometry that it names replaced by numbers, and its certificate in ``geometry``.

    The path in its ``cad`` table, which is removed, is relative to ``folder``. Raise UnresolvedGeometry with one fault
    for each feature that the CAD file lacks or has in several places.
    """
    units: UnitSystem = "SI" if data.get("units") == "SI" else "mm-g-ms"
    try:
        table = CadTable.model_validate(data["cad"])
    except ValidationError as error:
        faults = faults_of(error, CadTable, units)
        keyed = [Fault(("cad", *f.keys), f.text, f.value, f.unit) for f in faults]
        raise UnresolvedGeometry(keyed) from None
    try:
        assembly = read_step(folder / table.file, table.recognition)
    except CadError as error:
        raise UnresolvedGeometry([Fault(("cad", "file"), str(error), table.file)]) from None
    if assembly.sha256 != table.sha256:
        text = (
            f"{table.file} has another content, with the SHA-256 {assembly.sha256}; allowed: the content that this file"
            f" was written for; see what changed, and bring the file to it, with clearcap mechanism import"
            f" {quote(str(folder / table.file))} --update {quote(source)}"
        )
        raise UnresolvedGeometry([Fault(("cad", "sha256"), text, table.sha256)])
    used = [part for body in named_tables(data, "bodies").values() for part in parts_of_body(body)]
    damaged = [part for part in assembly.damaged if part in used]
    if damaged and not table.accept_damage:
        text = f"{assembly.damage}, or take what is left with accept_damage = true beside it"
        raise UnresolvedGeometry([Fault(("cad", "file"), text, table.file)])
    plain, tables = without_selectors(data, assembly)
    gaps, not_measured = drawn_gaps(folder / table.file, assembly.sha256, tables.pairs, tables.millimetre)
    certificate = GeometryCertificate(
        file=table.file,
        sha256=table.sha256,
        recognition=table.recognition,
        unreadable=assembly.unreadable if damaged else None,
        damaged=damaged,
        bodies=tables.bodies,
        faces=tables.faces,
        joints=tables.joints,
        gaps=gaps,
        not_measured=not_measured,
    )
    return {**plain, "geometry": certificate.model_dump(exclude_none=True)}


def without_selectors(data: Mapping[str, Any], assembly: CadAssembly) -> tuple[dict[str, Any], DrawnTables]:
    """Return a mechanism file without ``cad`` and with numbers for the features it names, and what was found for them.

    The assembly is in mm. Raise UnresolvedGeometry with one fault for each feature that it lacks or has in several
    places.
    """
    units: UnitSystem = "SI" if data.get("units") == "SI" else "mm-g-ms"
    joined = _joined_parts(data, assembly)
    assembly = with_joined_parts(assembly, joined, beside=True)
    drawn = assembly if units == "mm-g-ms" else in_unit(assembly, 1000.0)
    tables = DrawnTables(drawn, units, frozenset(joined), sub_table(data, "cad").get("density"))
    tables.faults.extend(_group_faults(data))
    plain = _plain({key: value for key, value in data.items() if key not in ("cad", "groups")}, (), tables)
    if "benches" in plain:
        benches = named_tables(data, "benches")
        plain["benches"] = {name: _plain(bench, ("benches", name), tables) for name, bench in benches.items()}
    if tables.faults:
        raise UnresolvedGeometry(tables.faults)
    return plain, tables


def _joined_parts(data: Mapping[str, Any], assembly: CadAssembly) -> dict[str, list[str]]:
    """Return the parts of each body that is made of several, by the name of the part that they become."""
    known = [part.name for part in assembly.parts]
    tables = [data, *named_tables(data, "benches").values()]
    bodies = [body for table in tables for body in named_tables(table, "bodies").values() if "parts" in body]
    joined = {}
    for body in bodies:
        parts = parts_of_body(body)
        if len(parts) > 1 and len(set(parts)) == len(parts) and set(parts) <= set(known):
            joined[joined_name(parts)] = parts
    return joined


def _group_faults(data: Mapping[str, Any]) -> list[Fault]:
    """Return a fault for each group with other parts than the body of its parts."""
    bodies = {name: parts_of_body(body) for name, body in named_tables(data, "bodies").items()}
    faults = []
    for group, parts in as_table(data.get("groups", {})).items():
        if not isinstance(parts, list) or not all(isinstance(part, str) for part in parts):
            faults.append(Fault(("groups", group), "no list of parts; allowed: names of parts; correct it", parts))
            continue
        other = [name for name, own in bodies.items() if set(own) & set(parts) and set(own) != set(parts)]
        if other:
            text = (
                f"not the parts of {', '.join(f'bodies.{name}' for name in other)}; allowed: the parts of one body; if"
                " this group is right, clearcap mechanism import with the STEP file and --update with this file brings"
                " bodies and joints to it"
            )
            faults.append(Fault(("groups", group), text, parts))
    return faults


def _plain(data: Mapping[str, Any], keys: tuple[str, ...], tables: DrawnTables) -> dict[str, Any]:
    """Return the file, or one of its benches, with plain numbers in its bodies, joints and contacts."""
    plain = dict(data)
    for table, made in (("bodies", tables.body), ("joints", tables.joint), ("contacts", tables.contact)):
        if isinstance(data.get(table), Mapping):
            plain[table] = {
                name: made((*keys, table, name), as_table(entry)) if isinstance(entry, Mapping) else entry
                for name, entry in sub_table(data, table).items()
            }
    return plain
