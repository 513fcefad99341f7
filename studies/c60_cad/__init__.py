"""Comparison of the C-60 in the CAD files published by its authors with the numbers of `c60.toml`.

`python -m studies.c60_cad FOLDER` prints the tables; the files are not part of this project ([cad](../../docs/cad.md)).
"""
