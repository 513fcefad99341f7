"""How many points a control chart takes until a test marks one: of a stable process by chance, and after a shift."""
