"""Tests of `engine.compiler`."""
