"""CAD files: STEP in, plain numbers out."""
