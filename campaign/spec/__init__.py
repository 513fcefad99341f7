"""The campaign file: its models, the data files beside it, loading, and messages about faults."""
