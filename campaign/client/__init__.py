"""Programs that ask a server of `clearcap serve`; nothing here knows the store or the engine's kernels."""
