"""Closed curves of lines and arcs, and the solids turned or extruded from them."""
