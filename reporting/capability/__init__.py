"""Capability indices of a response and their intervals."""

from reporting.capability.summary import Capability, capability

__all__ = ["Capability", "capability"]
