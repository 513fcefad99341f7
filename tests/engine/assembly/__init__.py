"""Tests of the assembly: what the arrays made of a description say."""
