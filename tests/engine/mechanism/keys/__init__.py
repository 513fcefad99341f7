"""Tests of the keys of a mechanism."""
