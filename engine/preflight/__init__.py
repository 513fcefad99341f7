"""Checks before a run: numbers in a wrong unit, motions without any load, rest that is detected too early."""

from engine.preflight.caution import Caution
from engine.preflight.cautions import cautions

__all__ = ["Caution", "cautions"]
