"""Measure the time of a step and of its stages with an instrumented time loop."""
