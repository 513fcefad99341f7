"""Withheld intervals: those of fitted distributions, percentiles and tails if values are in production lots.

They assume independent values. Intervals of mean, sigma, their indices and counted shares allow for lots.
"""

from collections.abc import Iterable
from dataclasses import replace

from reporting.shape.nonnormal import NonnormalIndices
from reporting.shape.tails import TailShare

OF_LOTS = "No interval: it would treat the values of a production lot as independent."


def without_intervals(
    methods: Iterable[NonnormalIndices], tails: Iterable[TailShare]
) -> tuple[tuple[NonnormalIndices, ...], tuple[TailShare, ...]]:
    """Return methods and tails for values in lots: the estimates without their intervals, with a note on why."""
    return (
        tuple(
            replace(
                method,
                pp_interval=None,
                ppk_interval=None,
                ppl_interval=None,
                ppu_interval=None,
                ppm_expected_interval=None,
                notes=(*method.notes, OF_LOTS),
            )
            for method in methods
        ),
        tuple(replace(tail, interval=None, note=f"{tail.note} {OF_LOTS}".strip()) for tail in tails),
    )
