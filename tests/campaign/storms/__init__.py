"""Campaigns while their processes are killed, on real processes that a supervisor starts again."""
