"""What reporting is given: rows, limits and provenance of a campaign; what-if questions."""
