"""A mechanism file and the CAD file it was written for, before a new revision of the CAD file replaces it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from engine.cad import RECOGNITION, CadAssembly, read_step
from engine.cad.assembly_cache import cached
from engine.errors import CadError, MechanismError
from engine.mechanism.tables import sub_table
from engine.platform.regular_file import read_regular_file
from engine.platform.toml_file import LARGEST, UnfitToml, parse_toml


@dataclass(frozen=True, eq=False)
class EarlierRevision:
    """A mechanism file, and the assembly named in its ``[cad]`` table."""

    text: str  # content of the mechanism file
    name: str  # of the mechanism
    file: str  # path of the CAD file, as given in the mechanism file
    assembly: CadAssembly  # in mm


def earlier_revision(path: Path) -> EarlierRevision:
    """Read a mechanism file and the earlier content of its CAD file, even if another file has replaced it since.

    Raises MechanismError if the mechanism file cannot be read or names no CAD file; CadError if the CAD file has other
    content now, and what was read of it before is no longer in the cache.
    """
    try:
        content = read_regular_file(path, LARGEST)
        tables: dict[str, Any] = parse_toml(content)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise MechanismError(f"{path}: cannot be read ({reason}); give the mechanism file") from None
    except UnfitToml as error:
        raise MechanismError(f"{path}: {error}") from None
    cad, name = sub_table(tables, "cad"), tables.get("name")
    file, sha256, recognition = cad.get("file"), cad.get("sha256"), cad.get("recognition", RECOGNITION)
    if not (isinstance(file, str) and isinstance(sha256, str) and isinstance(name, str)):
        raise MechanismError(f"{path}: names no CAD file with its sha256; give a file of mechanism import")
    assembly = cached(sha256, float(recognition))
    if assembly is None:
        assembly = read_step(path.parent / file, float(recognition))
        if assembly.sha256 != sha256:
            raise CadError(
                f"{path}: {file} has another content by now, and what it held is not kept here; put the earlier file"
                " back, and give the new one another name"
            )
    return EarlierRevision(content.decode("utf-8-sig"), name, file, assembly)
