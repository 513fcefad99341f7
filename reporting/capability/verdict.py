"""From an index to a word: capable, marginal, not capable."""

from reporting.capability.summary import Capability

# A response is capable from the first Cpk on and marginal from the second on (AIAG; Montgomery, Introduction to
# Statistical Quality Control).
CAPABLE, MARGINAL = 1.33, 1.00


def verdict(capability: Capability) -> str:
    """Return "capable", "marginal" or "not capable"; "no verdict" without a Cpk, "no limits" without limits."""
    if capability.lsl is None and capability.usl is None:
        return "no limits"
    return "no verdict" if capability.cpk is None else class_of(capability.cpk)


def class_of(cpk: float) -> str:
    """Return "capable", "marginal" or "not capable" for a Cpk."""
    return "capable" if cpk >= CAPABLE else "marginal" if cpk >= MARGINAL else "not capable"
