"""CAD files: STEP in, plain numbers out. Needs the extra ``clearcap[cad]`` only while a file is read."""
