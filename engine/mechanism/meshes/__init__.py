"""Meshes as convex pieces: their file, the pieces, and the certificate of how far these are from the mesh."""
