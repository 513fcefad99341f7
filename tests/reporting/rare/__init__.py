"""Tests of the rare rejects."""
