"""Tests of the parameters of a mechanism."""
