"""Where the time of a run goes: the time loop with clocks, and the times of a step."""
