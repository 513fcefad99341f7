"""``clearcap mechanism import``: mechanism files from a STEP file and from its next revision."""
