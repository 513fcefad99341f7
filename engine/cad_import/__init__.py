"""A mechanism file proposed from a CAD file: what was found in it, and questions about what only a person knows."""
