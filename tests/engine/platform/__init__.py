"""Tests of `engine.platform`."""
