"""The motion of one run as an HDF5 file that any HDF5 library reads: written while the run goes, and read back."""

from engine.trajectory.read import BodyMotion, ContactHistory, Trajectory, read_trajectory

__all__ = ["BodyMotion", "ContactHistory", "Trajectory", "read_trajectory"]
