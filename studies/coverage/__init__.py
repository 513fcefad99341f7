"""Coverage of the report's intervals: how often each contains the true value, by simulation.

A production draws values whose true mean, sigma, indices and shares are known. The report's own functions analyse each
draw. An interval covers the true value, misses it low or high, has a warning on the page, or is withheld.
"""
