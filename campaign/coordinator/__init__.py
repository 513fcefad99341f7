"""Compute a campaign from its plan to a complete store: work queue, dispatch, results, lease and heartbeat."""
