"""What a user writes in a campaign file: its models, the data files beside it, loading, messages."""
