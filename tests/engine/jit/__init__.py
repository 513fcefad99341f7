"""Tests of `engine.jit`."""
