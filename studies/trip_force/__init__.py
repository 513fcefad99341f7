"""Search for a set of assumptions that gives the C-60's tripping force and both of its distances.

Its tables are in studies/trip_force/README.md.

The bench `trip_pin` is simulated with the clearances of the prototype, over grids of properties that no source gives:
friction of each contact, a spring on the tripping bar, side and guide of the pin, settling, depth of the latch, and the
way in which a distance is read. None of them is adopted in the mechanism.
"""
