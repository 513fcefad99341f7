"""What the intervals of the report are worth: how often each holds the true value, by simulation.

A production draws values whose true mean, sigma, indices and shares are known. The report's own functions judge each
draw. An interval covers its truth, misses it low or high, is warned of on the page, or is withheld.
"""
