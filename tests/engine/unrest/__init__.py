"""Tests of `engine.unrest`."""
