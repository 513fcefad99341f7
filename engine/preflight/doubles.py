"""Joints and contacts written twice: each of the two carries a share of the force that one would carry."""

from collections.abc import Iterator

from engine.mechanism import Mechanism
from engine.preflight.caution import Caution


def doubles_of(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield the joints and contacts whose entries are identical to another one in the same table."""
    for table, entries in (("joints", mechanism.joints), ("contacts", mechanism.contacts)):
        first: dict[str, str] = {}
        for name, entry in entries.items():
            other = first.setdefault(repr(entry), name)
            if other != name:
                yield Caution(
                    f"{table}.{name}",
                    None,
                    "1",
                    f"the same as {table}.{other}: the forces are shared between the two",
                    "",
                    "remove one of them",
                )
