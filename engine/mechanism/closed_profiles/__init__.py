"""Closed curves of lines and arcs, and the solids that are turned or extruded from them."""
