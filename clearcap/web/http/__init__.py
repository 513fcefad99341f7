"""Middleware and dependencies of every request: limits, headers, authentication, problem details, audit, metrics."""
