"""``clearcap mechanism import``: a STEP file, and its next revision."""
