"""From a plan to a complete store: the work queue, dispatch, results, lease and heartbeat of a campaign."""
