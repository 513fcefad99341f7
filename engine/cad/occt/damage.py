"""What is lost because OCCT could not read some of a file's entities, judged by what depends on them.

An entity counts as damaged if a number or a reference of it is missing, and faces or places of a product are made from
it. Limits and zones that are lost are only said to be: the shapes are whole without them. Names, styles and texts that
break the standard, which many CAD programs write, count only as odd.
"""

import re
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from OCP.StepData import StepData_UndefinedEntity
from OCP.StepRepr import StepRepr_Representation

_RECORD = re.compile(r"#(\d+)\s*=\s*((?:[^';]|'[^']*')*);")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_TEXT = re.compile(r"'[^']*'")
_REFERENCE = re.compile(r"#(\d+)")
_KEYWORD = re.compile(r"[A-Z][A-Z0-9_]*")

_HARMLESS = re.compile(r"not a quoted String|not a Logical|numeration", re.IGNORECASE)
_UNRESOLVED = "unresolved"
_OTHER_KIND = "illegal type"
_DRAWING = "StepVisual_"
_SHAPES = re.compile(r"SOLID|BREP|SHELL|FACE|SURFACE_MODEL|MAPPED_ITEM")

_PLACES = ("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION", "NEXT_ASSEMBLY_USAGE_OCCURRENCE")
_LIMITS = ("DIMENSIONAL_CHARACTERISTIC_REPRESENTATION", "PLUS_MINUS_TOLERANCE", "GEOMETRIC_ITEM_SPECIFIC_USAGE")
_SHAPE_OF, _SHAPE = "SHAPE_DEFINITION_REPRESENTATION", "PRODUCT_DEFINITION_SHAPE"
_SAME_SHAPE = "SHAPE_REPRESENTATION_RELATIONSHIP"
_TO_PRODUCT = re.compile(
    r"PRODUCT|NEXT_ASSEMBLY_USAGE_OCCURRENCE|PRODUCT_DEFINITION\w*|SHAPE_ASPECT|\w*_SHAPE_ASPECT|DIMENSIONAL_\w+"
)


@dataclass(frozen=True)
class Damage:
    """The entities of a file that OCCT could not read."""

    entities: int = 0  # number of those that faces or places are made from
    products: frozenset[str] | None = frozenset()
    """Names of the products that these belong to; None if it is not known of each."""
    limits: int = 0  # number of those that only limits and zones are made from
    odd: int = 0  # number of all others


def damage_of(model: Any, path: Path) -> Damage:
    """Return what is lost of a file that OCCT has read into a model."""
    places = range(1, model.NbEntities() + 1)
    failed = {place for place in places if model.IsErrorEntity(place)}
    if not failed:
        return Damage()
    entities = {place: model.Value(place) for place in places}
    unknown = {place: entity for place, entity in entities.items() if isinstance(entity, StepData_UndefinedEntity)}
    shapes = {place for place, entity in unknown.items() if _SHAPES.search(str(entity.StepType()))}
    drawing = {place for place, entity in entities.items() if type(entity).__name__.startswith(_DRAWING)}
    drawing |= unknown.keys() - shapes
    lacking = {place for place in failed - drawing if _lacks(model, place, lost_shapes=bool(shapes))}
    if not lacking:
        return Damage(odd=len(failed))
    records = _Records(_COMMENT.sub("", path.read_text("latin-1")))
    if len(records.ids) != len(places):  # the entity of a record is not known
        return Damage(len(lacking), None, odd=len(failed - lacking))
    of_drawing = {records.ids[place - 1] for place in drawing}
    roots = {place: records.roots_above(records.ids[place - 1], of_drawing) for place in lacking}
    shaping = {place: [root for root in each if not records.is_limit(root)] for place, each in roots.items()}
    damaged = [place for place in lacking if shaping[place]]
    limits = [place for place in lacking if roots[place] and not shaping[place]]
    products = {records.product_below(root) for place in damaged for root in shaping[place]}
    places_of = {records.ids[place - 1]: place for place in places} if damaged else {}
    names = [str(entities[places_of[each]].Name().ToCString()) if each is not None else None for each in products]
    known = frozenset(name for name in names if name is not None)
    odd = len(failed) - len(damaged) - len(limits)
    return Damage(len(damaged), known if None not in names else None, len(limits), odd)


def _lacks(model: Any, place: int, *, lost_shapes: bool) -> bool:
    """Return whether a number or a reference of an entity is missing.

    An item of a representation that is of another kind than OCCT expects is a text or a leader on the drawing, unless
    the file has shapes unknown to OCCT.
    """
    check, entity = model.ReportEntity(place).Check(), model.Value(place)
    fails = [str(check.CFail(number, True)) for number in range(1, check.NbFails() + 1)]
    unresolved = any(_UNRESOLVED in fail for fail in fails)
    of_drawing = isinstance(entity, StepRepr_Representation) and not unresolved and not lost_shapes
    is_unit = type(entity).__name__.startswith("StepBasic_") and "Unit" in type(entity).__name__
    return any(
        not _HARMLESS.search(fail)
        and not (of_drawing and _OTHER_KIND in fail)
        and not (is_unit and "(dimensions)" in fail and not unresolved)
        for fail in fails
    )


class _Records:
    """The records of a STEP file and what they refer to, as text: OCCT gives no graph of entities it cannot read."""

    def __init__(self, text: str) -> None:
        found = [(int(number), _TEXT.sub("", body)) for number, body in _RECORD.findall(text)]
        self.ids = [number for number, _ in found]
        self._body = dict(found)

    def _kind(self, number: int) -> str:
        """Return the keyword of a record; empty for one of several, or a missing one."""
        found = _KEYWORD.match(self._body.get(number, ""))
        return found[0] if found else ""

    def _below(self, number: int) -> list[int]:
        return [int(each) for each in _REFERENCE.findall(self._body.get(number, ""))]

    @cached_property
    def _above(self) -> dict[int, list[int]]:
        """For each record those that refer to it."""
        above: dict[int, list[int]] = defaultdict(list)
        for number in self._body:
            for other in self._below(number):
                above[other].append(number)
        return above

    def _is_root(self, number: int) -> bool:
        """Return whether a record gives a product its shape, its place or a limit."""
        kind = self._kind(number)
        if kind == _SHAPE_OF:
            below = self._below(number)
            return len(below) < 2 or self._kind(below[0]) == _SHAPE
        return kind in _PLACES or self.is_limit(number)

    def is_limit(self, number: int) -> bool:
        """Return whether a record gives a product a limit."""
        return self._kind(number) in _LIMITS

    def roots_above(self, number: int, without: set[int]) -> list[int]:
        """Return the records of shapes, places and limits of products that depend on a record, or are it.

        What depends on it only through the records `without` does not count.
        """
        seen, todo, roots = {number, *without}, [number], []
        while todo:
            here = todo.pop()
            if self._is_root(here):
                roots.append(here)
                continue
            beyond = self._below(here) if self._kind(here) == _SAME_SHAPE else []
            for other in (*self._above.get(here, ()), *beyond):
                if other not in seen:
                    seen.add(other)
                    todo.append(other)
        return roots

    def product_below(self, root: int) -> int | None:
        """Return the record of the product of such a record; None if it is not known."""
        seen, todo = {root}, [root]
        while todo:
            here = todo.pop()
            if self._kind(here) == "PRODUCT":
                return here
            below = self._below(here)
            if self._kind(here) == _PLACES[1]:  # an assembly, then the part in it
                below = below[1:2]
            for other in below:
                if other not in seen and _TO_PRODUCT.fullmatch(self._kind(other)):
                    seen.add(other)
                    todo.append(other)
        return None
