"""The C-60 in the CAD files that its authors have published, beside the numbers of `c60.toml`.

`python -m studies.c60_cad FOLDER` prints the tables; the files are not part of this project ([cad](../../docs/cad.md)).
"""
