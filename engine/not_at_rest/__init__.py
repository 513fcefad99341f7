"""How a mechanism not at rest moves: which body, in which direction, how fast, and what would bring it to rest."""

from engine.not_at_rest.diagnosis import flight, in_flight, unheld, unrest

__all__ = ["flight", "in_flight", "unheld", "unrest"]
