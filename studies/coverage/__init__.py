"""Coverage of the report's intervals, by simulation: `python -m studies.coverage`."""
