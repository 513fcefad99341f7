"""Campaigns of simulations: specs, sampling, the store, dask, the command line."""
