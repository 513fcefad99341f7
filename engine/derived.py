"""Responses that follow from others: differences, conditions, and what friction leaves open of forces at rest."""

import math
from collections.abc import Mapping

from engine.mechanism import Mechanism
from engine.mechanism.derived import ConditionMet, ResponseDifference
from engine.mechanism.responses import ContactForce

Range = tuple[float, float]


def bounded_contacts(mechanism: Mechanism) -> list[str]:
    """Return the contacts of which a response asks for a bound of the force."""
    responses = mechanism.responses.values()
    return list(dict.fromkeys(r.contact for r in responses if isinstance(r, ContactForce) and r.bound))


def read_contacts(mechanism: Mechanism) -> dict[str, str]:
    """Return response -> contact of all normal forces that are read at the end."""
    return {
        name: r.contact
        for name, r in mechanism.responses.items()
        if isinstance(r, ContactForce) and r.component == "normal" and r.at == "end" and r.bound is None
    }


def with_derived(mechanism: Mechanism, measured: Mapping[str, float], ranges: Mapping[str, Range]) -> dict[str, float]:
    """Return what was measured, and what follows from it.

    Parameters
    ----------
    measured : response -> value; NaN where it has none
    ranges : contact -> least and largest normal force at rest; contacts that were not at rest are missing
    """
    found = dict(measured)
    for name, response in mechanism.responses.items():
        if isinstance(response, ResponseDifference):
            found[name] = measured[response.of[0]] - measured[response.of[1]]
        elif isinstance(response, ConditionMet):
            known = not math.isnan(measured[response.condition.response])
            found[name] = float(response.condition.holds(measured)) if known else math.nan
        elif isinstance(response, ContactForce) and response.bound:
            least, largest = ranges.get(response.contact, (math.nan, math.nan))
            found[name] = least if response.bound == "least" else largest
    return found
