"""The motion of one run as an HDF5 file that any HDF5 library reads: written while the run goes, and read back."""

from engine.trajectory.read import BodyMotion, ContactHistory, Trajectory, read_trajectory
from engine.trajectory.recording import Recording

__all__ = ["BodyMotion", "ContactHistory", "Recording", "Trajectory", "read_trajectory"]
