"""Reports of a campaign and questions about its samples; passes rows, limits and provenance to `reporting`."""
