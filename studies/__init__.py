"""Studies whose tables stand in the documentation; each is run by `python -m studies.NAME`."""
