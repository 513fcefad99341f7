"""Whether one set of assumptions gives the C-60's tripping force and both of its distances: docs/c60-trip.md.

The bench `trip_pin` with the clearances of the prototype, over grids of what no source tells: friction of each contact,
a spring on the tripping bar, side and guide of the pin, settling, the latch's depth, and how a distance is read.
Nothing of it is taken over into the mechanism.
"""
