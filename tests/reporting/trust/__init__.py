"""Tests of the trust card."""
