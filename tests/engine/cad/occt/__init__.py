"""Tests of `engine.cad.occt`: what OCCT has read is what was drawn."""
