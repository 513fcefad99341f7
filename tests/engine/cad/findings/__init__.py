"""Tests of `engine.cad.findings`."""
