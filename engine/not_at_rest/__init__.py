"""How a mechanism not at rest moves: which body, in which direction, how fast, and what would bring it to rest."""

from engine.not_at_rest.diagnosis import describe_motion, flight, in_flight, unheld

__all__ = ["describe_motion", "flight", "in_flight", "unheld"]
