"""Studies whose tables are in the documentation; each is run by `python -m studies.NAME`."""
