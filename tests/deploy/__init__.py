"""Tests of the descriptors in deploy/, and of a cluster on hosts of its own."""
