"""Reports of a campaign and questions to its samples: hands rows, limits and provenance to `reporting`."""
