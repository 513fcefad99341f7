"""Statistical tolerance intervals: limits that contain a stated share of production, with a stated confidence."""
