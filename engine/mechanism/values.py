"""One number of a mechanism by its key: read it, its unit, or set it.

A key is a joint's name, which stands for its radial clearance, or the dotted path of a number in the file:
`springs.A3.preload`, `materials.plastic_plastic.friction`. Setting happens once for each sample of a campaign, so
only the tables on the way to the number are checked again, not the whole mechanism.
"""

import math
from collections.abc import Iterator, Mapping
from numbers import Real
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ValidationError

from engine.errors import MechanismError
from engine.mechanism.faults import Fault, did_you_mean, faults_of, field_of, field_quantity

if TYPE_CHECKING:
    from engine.mechanism.models import Mechanism


def value(mechanism: "Mechanism", key: str) -> float:
    """Return the number a key stands for; see `Mechanism.value`."""
    return float(_nodes(mechanism, key)[-1])


def unit_of(mechanism: "Mechanism", key: str) -> str:
    """Return the unit of the number a key stands for; see `Mechanism.unit_of`."""
    owner = _nodes(mechanism, key)[-2]
    field = field_of(type(owner), _path(mechanism, key)[-1])
    quantity = field_quantity(field) if field else None
    return quantity.unit(mechanism.units) if quantity else "1"


def canonical_key(mechanism: "Mechanism", key: str) -> str:
    """Return the dotted path of a key; see `Mechanism.canonical_key`."""
    _nodes(mechanism, key)
    return ".".join(_path(mechanism, key))


def settable_keys(mechanism: "Mechanism") -> list[str]:
    """Return every key that may be set: the joints' names first, then all dotted paths."""
    return [*mechanism.joints, *_leaves(mechanism, "")]


def set_values(mechanism: "Mechanism", changes: Mapping[str, float]) -> "Mechanism":
    """Return the mechanism with some of its numbers replaced.

    Parameters
    ----------
    mechanism : Mechanism
        Left as it is.
    changes : mapping
        Key -> number, in the unit of the key. A key is a joint's name (its radial clearance) or a dotted path.

    Returns
    -------
    Mechanism

    Raises
    ------
    MechanismError
        One line for each key that is unknown or whose number is not allowed.
    """
    faults: list[str] = []
    for key, number in changes.items():
        try:
            unit = unit_of(mechanism, key)
            if not isinstance(number, Real) or isinstance(number, bool) or not math.isfinite(number):
                text = f"not a finite number; allowed: a number in {unit}; give one"
                raise MechanismError(str(Fault(key, text, number)))
            mechanism = _replaced(mechanism, key, float(number), unit)
        except MechanismError as error:
            faults.append(f"  {error}")
    if faults:
        raise MechanismError("\n".join([f"mechanism {mechanism.name}: values that cannot be set", *faults]))
    return mechanism


def _replaced(mechanism: "Mechanism", key: str, number: float, unit: str) -> "Mechanism":
    """Return the mechanism with one number replaced, every table on the way to it checked again."""
    path, nodes = _path(mechanism, key), _nodes(mechanism, key)
    new: Any = number
    for depth in range(len(path) - 1, 0, -1):
        node, token = nodes[depth], path[depth]
        if isinstance(node, BaseModel):
            same = {
                field.alias or name: getattr(node, name) for name, field in type(node).model_fields.items()
            }
            try:
                new = type(node).model_validate({**same, token: new})
            except ValidationError as error:
                fault = faults_of(error, type(node), mechanism.units)[0]
                at_fault = fault.key == ".".join(path[depth:])
                text = fault.text if at_fault else f"then {'.'.join(path[:depth])}.{fault}"
                raise MechanismError(str(Fault(key, text, number, unit))) from None
        else:
            new = _with_item(node, token, new)
    return mechanism.model_copy(update={path[0]: new})


def _with_item(items: Any, token: str, new: Any) -> Any:
    """Return a dict or tuple with one item replaced."""
    if isinstance(items, Mapping):
        return {**items, token: new}
    return tuple(new if str(i) == token else item for i, item in enumerate(items))


def _path(mechanism: "Mechanism", key: str) -> list[str]:
    """Return the path of a key: a joint's name stands for its radial clearance."""
    return ["joints", key, "radial_clearance"] if key in mechanism.joints else key.split(".")


def _nodes(mechanism: "Mechanism", key: str) -> list[Any]:
    """Return what lies on the way to a number: the mechanism first, the number last."""
    nodes: list[Any] = [mechanism]
    for token in _path(mechanism, key):
        nodes.append(_child(nodes[-1], token))
    if isinstance(nodes[-1], float):
        return nodes
    known = settable_keys(mechanism)
    below = [k for k in known if k.startswith(f"{key}.")]
    if nodes[-1] is None and _is_field(nodes[-2], key.rpartition(".")[2]):
        raise MechanismError(f"{key}: has no number in this mechanism; write one into the file first")
    if nodes[-1] is None:
        raise MechanismError(
            f"{key}: unknown key; allowed: a joint ({', '.join(mechanism.joints) or 'there is none'}), whose radial "
            f"clearance it sets, or the dotted path of a number in the file{did_you_mean(key, known)}"
        )
    there = f"; below it: {', '.join(below[:8])}{', ...' if len(below) > 8 else ''}" if below else ""
    raise MechanismError(f"{key}: not a single number; only single numbers can be set{there}")


def _child(node: Any, token: str) -> Any:
    """Return what ``token`` names inside ``node``; None when there is no such thing."""
    if isinstance(node, BaseModel):
        name = next((n for n, field in type(node).model_fields.items() if token == (field.alias or n)), None)
        return getattr(node, name) if name else None
    if isinstance(node, Mapping):
        return node.get(token)
    if isinstance(node, tuple) and token.isdecimal() and int(token) < len(node):
        item = node[int(token)]
        return item if isinstance(item, BaseModel) else None
    return None


def _is_field(node: Any, token: str) -> bool:
    return isinstance(node, BaseModel) and field_of(type(node), token) is not None


def _leaves(node: Any, prefix: str) -> Iterator[str]:
    """Yield the dotted path of every single number below ``node``."""
    if isinstance(node, BaseModel):
        below = [
            (field.alias or name, getattr(node, name)) for name, field in type(node).model_fields.items()
        ]
    elif isinstance(node, Mapping):
        below = list(node.items())
    elif isinstance(node, tuple):
        below = [(str(i), item) for i, item in enumerate(node) if isinstance(item, BaseModel)]
    else:
        below = []
    for token, child in below:
        if isinstance(child, float):
            yield prefix + token
        yield from _leaves(child, f"{prefix}{token}.")
