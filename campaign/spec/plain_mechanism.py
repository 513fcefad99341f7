"""A mechanism as a file with plain numbers in place of the geometry that it takes from a CAD file."""

from typing import Any

import tomli_w

from engine.mechanism import Mechanism


def plain_tables(mechanism: Mechanism) -> dict[str, Any]:
    """Return the tables of a mechanism file that needs no CAD file."""
    return mechanism.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True, exclude={"geometry"})


def plain_text(mechanism: Mechanism) -> str:
    """Return the text of a mechanism file that needs no CAD file."""
    return tomli_w.dumps(plain_tables(mechanism))
