"""Contact geometry: gaps, contact points and local frames of all pairs of primitives."""
