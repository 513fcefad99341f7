"""What can be known before a run: numbers in a wrong unit, motions that nothing loads, a rest that comes too early."""

from engine.preflight.caution import Caution
from engine.preflight.cautions import cautions

__all__ = ["Caution", "cautions"]
