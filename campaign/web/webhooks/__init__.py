"""Other systems are told when a campaign ends, or when a Cpk is too small."""
