"""Tests of engine.mechanism."""
