"""The message for a key that names no number of a mechanism: what exists there, and which key may be meant."""

from collections.abc import Iterator, Mapping, Sequence

from engine.mechanism.closest import closest
from engine.mechanism.keys.places import Place, along, settable_places
from engine.mechanism.models import Mechanism

MOST_NAMED = 20


def unknown_key(mechanism: Mechanism, key: str) -> str:
    """Return the message that no number has this key, with what exists where it goes wrong and the likely key."""
    meant = meant_key(mechanism, key)
    question = f"; did you mean '{meant}'?" if meant else ""
    places = along(mechanism, key.split("."))
    if len(places) > 1:
        known = ".".join(key.split(".")[: len(places) - 1])
        below = list(places[-1].below())
        names = ", ".join(below[:MOST_NAMED]) + (", ..." if len(below) > MOST_NAMED else "")
        return f"unknown key; {f'{known} has {names}' if below else f'{known} has nothing inside'}{question}"
    joints = ", ".join(mechanism.joints) or "there is none"
    return (
        f"unknown key; allowed: a joint ({joints}), whose clearance it sets, "
        f"or the dotted path of a number in the file, as clearcap mechanism show --keys lists them{question}"
    )


def meant_key(mechanism: Mechanism, key: str) -> str:
    """Return the key of the existing number that an unknown key most likely means; empty if none is likely.

    Tokens are matched table by table: a wrong token matches a name there that differs by a slip, and an index matches
    the component at its place. If the table is missing from the key, all tables are searched for the name; a single
    token matches the first number whose key ends with it.
    """
    tokens = key.split(".")
    root = Place(mechanism)
    for start in (root, *(place for place in root.below().values() if isinstance(place.value, Mapping))):
        table = [token for token, place in root.below().items() if place.value is start.value][:1]
        if found := next(_followed(start, tokens, exact=start is not root), None):
            return ".".join([*(table if start is not root else []), *found])
    return _of_this_name(mechanism, tokens[-1]) if len(tokens) == 1 else ""


def _followed(place: Place, tokens: Sequence[str], *, exact: bool) -> Iterator[list[str]]:
    """Yield the path to a number below a place that resembles the tokens; with ``exact`` the first token must match."""
    if not tokens:
        if isinstance(place.value, float):
            yield []
        return
    below, token = place.below(), tokens[0]
    by_index = dict(zip(map(str, range(len(below))), below, strict=True)) if isinstance(place.value, tuple) else {}
    twins = {f"{axis}{axis}": axis for axis in "xyz"} | {name: name[::-1] for name in ("xy", "xz", "yz")}
    likely = [name for name in below if name == token or twins.get(name) == token]
    if not exact:
        likely += [name for name in (by_index.get(token), closest(token, below)) if name]
    for name in likely:
        for rest in _followed(below[name], tokens[1:], exact=False):
            yield [name, *rest]


def _of_this_name(mechanism: Mechanism, token: str) -> str:
    """Return the first key whose last token is the given one."""
    return next((key for key, _ in settable_places(mechanism) if key.rpartition(".")[2] == token), "")
