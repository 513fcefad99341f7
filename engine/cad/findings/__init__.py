"""Find features of a mechanism in a CAD assembly: pins in holes, balls in sockets, flanges, possible stops."""
