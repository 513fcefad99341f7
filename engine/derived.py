"""Responses derived from others: differences, conditions, and bounds of contact forces at rest."""

import math
from collections.abc import Mapping

from engine.mechanism import Mechanism
from engine.mechanism.derived import ConditionMet, ResponseDifference
from engine.mechanism.responses import ContactForce

Range = tuple[float, float]


def bounded_contacts(mechanism: Mechanism) -> list[str]:
    """Return the contacts whose force range at rest is used by a response."""
    responses = mechanism.responses.values()
    return list(dict.fromkeys(r.contact for r in responses if isinstance(r, ContactForce) and r.bound))


def read_contacts(mechanism: Mechanism) -> dict[str, str]:
    """Return a mapping response -> contact for all normal forces that are read at the end of the run."""
    return {
        name: r.contact
        for name, r in mechanism.responses.items()
        if isinstance(r, ContactForce) and r.component == "normal" and r.at == "end" and r.bound is None
    }


def with_derived(mechanism: Mechanism, measured: Mapping[str, float], ranges: Mapping[str, Range]) -> dict[str, float]:
    """Return the measured responses together with those derived from them; NaN: no value.

    ``ranges`` gives the smallest and largest normal force at rest by contact; contacts that were not at rest are
    missing.
    """
    responses = dict(measured)
    for name, response in mechanism.responses.items():
        if isinstance(response, ResponseDifference):
            responses[name] = measured[response.of[0]] - measured[response.of[1]]
        elif isinstance(response, ConditionMet):
            defined = not math.isnan(measured[response.condition.response])
            responses[name] = float(response.condition.holds(measured)) if defined else math.nan
        elif isinstance(response, ContactForce) and response.bound:
            least, largest = ranges.get(response.contact, (math.nan, math.nan))
            responses[name] = least if response.bound == "least" else largest
    return responses
