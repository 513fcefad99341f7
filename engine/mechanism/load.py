"""Load a mechanism from a TOML file, from the text or the tables of one, or from the shipped mechanisms by name."""

import os
from collections.abc import Mapping
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from engine.errors import Fault, MechanismError
from engine.faults.file_kinds import content_kind, other_kind, unreadable_kind
from engine.faults.toml_positions import with_positions
from engine.mechanism.faults import did_you_mean
from engine.mechanism.geometry.resolved_geometry import UnresolvedGeometry, with_geometry
from engine.mechanism.meshes.resolved_meshes import UnresolvedMesh, names_meshes, with_meshes
from engine.mechanism.models import Mechanism, mechanism_from, python_data, refused
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml, text_bytes


def library_names() -> list[str]:
    """Return the names of the shipped mechanisms, sorted."""
    shipped = files("engine.mechanism").joinpath("library").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in shipped if file.name.endswith(".toml"))


def load_mechanism(name_or_path: str | Path | Mapping[str, Any]) -> Mechanism:
    """Load a mechanism.

    Parameters
    ----------
    name_or_path : str, Path or mapping
        Name of a shipped mechanism; path of a TOML file; or the tables of such a file as Python data, built in code:
        numbers may be of NumPy, and vectors its arrays. A name contains neither a folder nor ``.toml``.

    Returns
    -------
    Mechanism
        Immutable and checked.

    Raises
    ------
    MechanismError
        If the file cannot be found or read, or with one line for each fault in it.
    """
    if isinstance(name_or_path, Mapping):
        name = str(name_or_path.get("name", "mechanism"))[:200]
        return mechanism_from(_plain(python_data(name_or_path), name, None), name)
    text = str(name_or_path)
    if isinstance(name_or_path, str) and text in library_names():
        shipped = files("engine.mechanism").joinpath("library", f"{text}.toml")
        return _read(shipped, text)
    path = Path(name_or_path)
    if "\0" in text:
        raise _refused(f"{text!r:.200}", "no file has such a name; give the path of a TOML file")
    if not os.path.exists(path) and path.suffix != ".toml" and len(path.parts) == 1:
        known = library_names()
        raise _refused(
            text,
            f"no such mechanism; shipped are {', '.join(known)}; "
            f"name one of them, or give the path of a TOML file{did_you_mean(text, known)}",
        )
    return _read(path, text)


def load_mechanism_text(text: str | bytes, name: str = "mechanism") -> Mechanism:
    """Load a mechanism from the text of its file. No other file is opened, so a text with a ``cad`` table is refused.

    Parameters
    ----------
    text : str or bytes
        Content of a TOML file, at most one megabyte; bytes are UTF-8.
    name : str
        Name used in errors, such as the name of the file that contained the text.

    Returns
    -------
    Mechanism
        Immutable and checked; the same as loaded from a file with this text.

    Raises
    ------
    MechanismError
        If the text is not TOML or not a mechanism, or with one line for each fault.
    """
    return _checked(text_bytes(text), name, None)


def _read(file: Path | Traversable, source: str) -> Mechanism:
    """Read and check a file; raise MechanismError if it is wrong."""
    try:
        content = read_regular_file(file, LARGEST) if isinstance(file, Path) else file.read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        unreadable = f"cannot be read ({reason}); give a mechanism's TOML file"
        raise _refused(source, unreadable_kind(source, "mechanism") or unreadable) from None
    return _checked(content, source, file.parent if isinstance(file, Path) else None)


def _checked(content: bytes, source: str, folder: Path | None) -> Mechanism:
    """Return the mechanism from the content of a file in a folder; raise MechanismError if it is wrong."""
    try:
        data = parse_toml(content)
    except UnfitToml as error:
        text = content_kind(content, "mechanism") or str(error)
        raise _refused(source, text, error.line, error.column) from None
    if other := other_kind(data, source, "mechanism"):
        raise _refused(source, other)
    if data and not data.keys() & {"format", "name", "units", "bodies"}:
        # a campaign may name any file; a file that is no mechanism at all must not be quoted fault by fault
        raise _refused(source, "not a mechanism: it has neither format nor name, units or bodies; name another")
    try:
        return mechanism_from(_plain(data, source, folder), source)
    except MechanismError as error:
        raise MechanismError(str(error), with_positions(error.faults, content)) from None


def _plain(data: dict[str, Any], source: str, folder: Path | None) -> dict[str, Any]:
    """Return the tables of a file with references to CAD geometry and to meshes replaced by numbers."""
    for key, what in (("geometry", "a CAD file"), ("meshes", "mesh files")):
        if key in data:
            text = f"written by clearcap where a mechanism names {what}, not by hand; remove it"
            raise refused(source, [Fault((key,), text)], 1)
    try:
        if folder is not None and names_meshes(data):
            data = with_meshes(data, folder)
    except UnresolvedMesh as error:
        raise refused(source, error.faults, len(error.faults)) from None
    if "cad" not in data:
        return data
    if folder is None:
        text = (
            "names a CAD file, and none is opened for a mechanism that comes as text; allowed: plain numbers; write"
            " them with clearcap mechanism plain FILE -o PLAIN.toml, and give that"
        )
        raise refused(source, [Fault(("cad",), text)], 1)
    try:
        return with_geometry(data, folder, source)
    except UnresolvedGeometry as error:
        raise refused(source, error.faults, len(error.faults)) from None


def _refused(source: str, text: str, line: int | None = None, column: int | None = None) -> MechanismError:
    """Return the error for a file as a whole."""
    return MechanismError(f"{source}: {text}", [Fault((), text, line=line, column=column)])
