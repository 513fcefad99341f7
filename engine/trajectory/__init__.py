"""The motion of one run as an HDF5 file for any HDF5 library: written during the run, and read back."""

from engine.trajectory.read import BodyMotion, ContactHistory, Recording, Trajectory, read_trajectory

__all__ = ["BodyMotion", "ContactHistory", "Recording", "Trajectory", "read_trajectory"]
