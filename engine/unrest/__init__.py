"""What a mechanism does that is not at rest: which body moves, where to, how fast, and what would bring it to rest."""

from engine.unrest.diagnosis import unheld, unrest

__all__ = ["unheld", "unrest"]
