"""The trust card: whether the numbers of the report can be relied on."""
