"""The word for a capability."""

from reporting.capability.summary import Capability

# From this Cpk on a response is capable, from the second on marginal.
CAPABLE, MARGINAL = 1.33, 1.00


def verdict(numbers: Capability) -> str:
    """Return the word for a capability: by Cpk, at 1.33 and 1.00."""
    if numbers.lsl is None and numbers.usl is None:
        return "no limits"
    return "no verdict" if numbers.cpk is None else class_of(numbers.cpk)


def class_of(cpk: float) -> str:
    """Return the class of a Cpk."""
    return "capable" if cpk >= CAPABLE else "marginal" if cpk >= MARGINAL else "not capable"
