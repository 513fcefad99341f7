"""Capability indices of a response and their intervals."""

from reporting.capability.capability import Capability, capability

__all__ = ["Capability", "capability"]
