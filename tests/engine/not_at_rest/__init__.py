"""Tests of `engine.not_at_rest`."""
