"""How a mechanism not at rest moves: which body, in which direction, how fast, and what would bring it to rest."""

from engine.unrest.body_in_flight import in_flight
from engine.unrest.diagnosis import flight, unheld, unrest

__all__ = ["flight", "in_flight", "unheld", "unrest"]
