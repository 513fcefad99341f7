"""The client of a `clearcap serve` server; it uses neither the store nor the engine's kernels."""
