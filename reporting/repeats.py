"""Samples that were simulated a second time with half the step, as checked arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import Array
from reporting.errors import ReportError
from reporting.samples import OK

if TYPE_CHECKING:
    import pyarrow


@dataclass(frozen=True)
class Repeats:
    """The repeats of a campaign, one entry per repeat."""

    # the sample that is repeated, shape (m,)
    sample: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    ok: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))  # whether the repeat succeeded
    values: dict[str, Array] = field(default_factory=dict)  # responses by name, shape (m,), NaN where there is no value
    planned: int = 0  # samples to be repeated
    remedy: str = ""  # sentence that says how to get more repeats; may be empty


def read_repeats(table: "pyarrow.Table | None", responses: Sequence[str], planned: int, remedy: str) -> Repeats:
    """Return the repeats of a table with the columns ``sample``, ``status`` and the responses; None without repeats.

    ReportError: a column is missing or of the wrong type, or a sample is repeated more than once.
    """
    if table is None:
        return Repeats(planned=planned, remedy=remedy)
    import pyarrow

    try:
        sample = table["sample"].to_numpy().astype(np.int64)
        ok = np.array([status == OK for status in table["status"].to_pylist()], np.bool_)
        values = {name: np.asarray(table[name].cast(pyarrow.float64()).to_numpy(), np.float64) for name in responses}
    except (KeyError, pyarrow.ArrowInvalid) as error:
        raise ReportError(f"the table of repeats cannot be read: {error}; give that of the campaign") from error
    if np.unique(sample).size < sample.size:
        raise ReportError("a sample is repeated more than once; give each repeat one row")
    return Repeats(sample, ok, values, planned, remedy)
