"""Compiled kernels: arrays in, arrays out, status codes, no Python objects, no allocation in the time loop."""
