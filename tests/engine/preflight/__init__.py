"""Tests of `engine.preflight`."""
