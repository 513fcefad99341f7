"""Read one number of a mechanism by its key, or its unit, or set it.

A key is a joint's name, which stands for its clearance, or the dotted path of a number in the file, such as
`springs.A3.preload`. An ideal joint has no number: the keys of its form with play have no effect on it. Setting happens
once for each sample of a campaign, so only the tables on the way to the number are checked again, not the whole
mechanism.
"""

import math
from collections.abc import Iterator, Mapping
from numbers import Real
from typing import Any

from pydantic import ValidationError

from engine.errors import MechanismError
from engine.mechanism.base import TableModel
from engine.mechanism.faults import Fault, did_you_mean, faults_of, field_of, field_quantity
from engine.mechanism.joints import Joint
from engine.mechanism.models import Mechanism
from engine.mechanism.readout import Event


def get_value(mechanism: Mechanism, key: str) -> float:
    """Return the number that a key stands for.

    Parameters
    ----------
    mechanism : Mechanism
    key : str
        A joint's name, which stands for its clearance, or a dotted path.

    Returns
    -------
    float
        In the unit of the key, see `unit_of`.

    Raises
    ------
    MechanismError
        If no number has this key; the message suggests the closest one.
    """
    return float(_nodes(mechanism, key)[-1])


def unit_of(mechanism: Mechanism, key: str) -> str:
    """Return the unit of the number that a key stands for; ``"1"`` for a pure number.

    Raises
    ------
    MechanismError
        If no number has this key.
    """
    owner = _nodes(mechanism, key)[-2]
    if isinstance(owner, Event):
        return mechanism.response_units()[owner.response]
    field = field_of(type(owner), _path(mechanism, key)[-1])
    quantity = field_quantity(field) if field else None
    return quantity.unit(mechanism.units) if quantity else "1"


def full_key(mechanism: Mechanism, key: str) -> str:
    """Return the dotted path that a key stands for: a joint's name stands for its clearance."""
    return f"joints.{key}.{mechanism.joints[key].CLEARANCE}" if key in mechanism.joints else key


def settable_keys(mechanism: Mechanism) -> list[str]:
    """Return every key that may be set: the names of the joints with play first, then all dotted paths."""
    return [*mechanism.loose_joints(), *_leaves(mechanism, "")]


def set_values(mechanism: Mechanism, changes: Mapping[str, float]) -> Mechanism:
    """Return the mechanism with some of its numbers replaced.

    Parameters
    ----------
    mechanism : Mechanism
        Left as it is.
    changes : mapping
        Key -> number, in the unit of the key; a joint's name (its clearance) or a dotted path.

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
            mechanism = _replaced(mechanism, key, _finite(key, number, unit), unit)
        except MechanismError as error:
            faults.append(f"  {error}")
    if faults:
        raise MechanismError("\n".join([f"mechanism {mechanism.name}: values that cannot be set", *faults]))
    return mechanism


def _finite(key: str, number: Any, unit: str) -> float:
    """Return ``number`` as a float; numpy's numbers are welcome, texts and booleans are not."""
    if isinstance(number, Real) and not isinstance(number, bool):
        try:
            finite = float(number)
        except OverflowError:  # a whole number beyond the range of floats
            finite = math.inf
        if math.isfinite(finite):
            return finite
    raise MechanismError(str(Fault(key, f"not a finite number; allowed: a number in {unit}; give one", number)))


def _replaced(mechanism: Mechanism, key: str, number: float, unit: str) -> Mechanism:
    """Return the mechanism with one number replaced, every table on the way to it checked again."""
    path, nodes = _path(mechanism, key), _nodes(mechanism, key)
    new: Any = number
    for depth in range(len(path) - 1, 0, -1):
        node, token = nodes[depth], path[depth]
        if isinstance(node, TableModel):
            try:
                new = type(node).model_validate({**node.entries(), token: new})
            except ValidationError as error:
                fault = faults_of(error, type(node), mechanism.units)[0]
                itself = fault.key == ".".join(path[depth:])
                text = fault.text if itself else f"then {'.'.join(path[:depth])}.{fault}"
                raise MechanismError(str(Fault(key, text, number, unit))) from None
        else:
            new = _with_item(node, token, new)
    return mechanism.model_copy(update={path[0]: new})


def _with_item(items: Any, token: str, new: Any) -> Any:
    """Return a dict or tuple with one item replaced."""
    if isinstance(items, Mapping):
        return {**items, token: new}
    return tuple(new if str(i) == token else item for i, item in enumerate(items))


def _path(mechanism: Mechanism, key: str) -> list[str]:
    """Return the path of a key, token by token."""
    return full_key(mechanism, key).split(".")


def _nodes(mechanism: Mechanism, key: str) -> list[Any]:
    """Return the objects on the path of a key: the mechanism first, the number last."""
    nodes: list[Any] = [mechanism]
    for token in _path(mechanism, key):
        if isinstance(nodes[-1], Joint) and nodes[-1].ideal:
            raise MechanismError(_without_play(key, nodes[-1]))
        below = _below(nodes[-1])
        if token not in below:
            raise MechanismError(_unknown(mechanism, key))
        nodes.append(below[token])
    if nodes[-1] is None:
        raise MechanismError(f"{key}: has no number in this mechanism; write one into the file first")
    if not isinstance(nodes[-1], float):
        inside = [k for k in settable_keys(mechanism) if k.startswith(f"{key}.")]
        inner_keys = f"; inside it: {', '.join(inside[:8])}{', ...' if len(inside) > 8 else ''}" if inside else ""
        raise MechanismError(f"{key}: not a single number; allowed: single numbers{inner_keys}")
    return nodes


def _without_play(key: str, joint: Joint) -> str:
    """Return the message that an ideal joint has no clearance, with the remedy."""
    remedy = f'write type = "clearance_{joint.type}" into the file first' if joint.CLEARANCE else "set another number"
    return f"{key}: a {joint.type} joint is ideal and has no play to set; {remedy}"


def _unknown(mechanism: Mechanism, key: str) -> str:
    """Return the message that no number has this key, with the keys that exist."""
    joints = ", ".join(mechanism.joints) or "there is none"
    return (
        f"{key}: unknown key; allowed: a joint ({joints}), whose clearance it sets, "
        f"or the dotted path of a number in the file{did_you_mean(key, settable_keys(mechanism))}"
    )


def _below(node: Any) -> Mapping[str, Any]:
    """Return the entries of ``node`` that a key can name."""
    if isinstance(node, Joint) and node.ideal:
        return {}
    if isinstance(node, TableModel):
        return {key: child for key, child in node.entries().items() if key not in ("benches", "presets")}
    if isinstance(node, tuple):
        return {str(i): item for i, item in enumerate(node) if isinstance(item, TableModel)}
    return node if isinstance(node, Mapping) else {}


def _leaves(node: Any, prefix: str) -> Iterator[str]:
    """Yield the dotted path of every single number below ``node``."""
    for token, child in _below(node).items():
        if isinstance(child, float):
            yield prefix + token
        yield from _leaves(child, f"{prefix}{token}.")
