"""The physics of one mechanism with one set of clearances: nonsmooth contact dynamics (paper, section 2)."""

from engine.errors import CadError, EngineError, Fault, FolderError, MechanismError, NotAssemblable, TrajectoryError
from engine.faults.toml_positions import TextPosition, position_of
from engine.mechanism import Mechanism, library_names, load_mechanism, load_mechanism_text, set_values
from engine.platform.build import build_id
from engine.run import Certificate, Run
from engine.simulate import check, missing_kernels, simulate, warm_up
from engine.trajectory import Recording, Trajectory, read_trajectory

__all__ = [
    "CadError",
    "Certificate",
    "EngineError",
    "Fault",
    "FolderError",
    "Mechanism",
    "MechanismError",
    "NotAssemblable",
    "Recording",
    "Run",
    "TextPosition",
    "Trajectory",
    "TrajectoryError",
    "build_id",
    "check",
    "library_names",
    "load_mechanism",
    "load_mechanism_text",
    "missing_kernels",
    "position_of",
    "read_trajectory",
    "set_values",
    "simulate",
    "warm_up",
]
