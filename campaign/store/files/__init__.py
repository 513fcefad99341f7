"""Files of a store, in a folder or behind an fsspec URL: each is written whole or not at all."""
