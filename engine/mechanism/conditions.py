"""Conditions on responses, such as "latch_overlap > 0"; a result that violates one does not count."""

import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

from engine.mechanism.base import refuse

CONDITION = re.compile(r"\s*([A-Za-z][A-Za-z0-9_-]*)\s*([<>])\s*(\S+)\s*")


@dataclass(frozen=True)
class Condition:
    """A response above or below a limit. A settled run that violates one of its validity conditions is ``invalid``."""

    response: str
    relation: str  # "<" or ">"
    limit: float  # in the unit of the response

    def __str__(self) -> str:
        return f"{self.response} {self.relation} {repr(self.limit).removesuffix('.0')}"

    def holds(self, responses: Mapping[str, float]) -> bool:
        """Return whether ``responses`` (name -> value) satisfy the condition."""
        compare = operator.lt if self.relation == "<" else operator.gt
        return bool(compare(responses[self.response], self.limit))


def _condition(value: Any) -> Condition:
    """Read ``"response > number"``."""
    if isinstance(value, Condition):
        return value
    match = CONDITION.fullmatch(value) if isinstance(value, str) else None
    try:
        if match is None:
            raise ValueError(value)
        condition = Condition(match[1], match[2], float(match[3]))
        if not abs(condition.limit) < float("inf"):
            raise ValueError(value)
    except ValueError:
        raise refuse(
            'not a condition; allowed: "response > number" or "response < number"; '
            'write for example "latch_overlap > 0"'
        ) from None
    return condition


ValidityCondition = Annotated[
    Condition,
    BeforeValidator(_condition),
    PlainSerializer(str),
    WithJsonSchema({"type": "string", "examples": ["latch_overlap > 0"]}),
]
