"""The physics of one mechanism with one set of clearances: nonsmooth contact dynamics (paper, section 2)."""

from engine.build import build_id
from engine.errors import EngineError, MechanismError
from engine.mechanism import Mechanism, library_names, load_mechanism, set_values
from engine.simulate import Certificate, Run, check, simulate, warm_up

__all__ = [
    "Certificate",
    "EngineError",
    "Mechanism",
    "MechanismError",
    "Run",
    "build_id",
    "check",
    "library_names",
    "load_mechanism",
    "set_values",
    "simulate",
    "warm_up",
]
