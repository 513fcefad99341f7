"""Checks before a run: numbers in a wrong unit, motions without any load, rest that is detected too early."""

from engine.preflight.cautions import cautions, check
from engine.preflight.plausibility import Caution

__all__ = ["Caution", "cautions", "check"]
