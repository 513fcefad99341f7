"""Measure the time of a step and of its stages, with a time loop that has clocks."""
