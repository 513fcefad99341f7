"""Samples read from the rows of a user's table."""

import numpy as np

from campaign.inputs.sampling.enumerating import EnumeratingSampler, check_bounds, check_names
from campaign.inputs.sampling.sampler import SampledInputs
from engine.arrays import Array


class UserTable(EnumeratingSampler):
    """Sample i is row i of a table."""

    name = "list"
    summary = "the rows of a table"
    report = (
        "The samples are a given list, which need not represent a production: sigma, indices and ppm describe "
        "the list only, and no verdict follows from them."
    )
    own_key = "table"

    def check(self, inputs: SampledInputs) -> None:
        """Raise ValueError unless the table has a column for each variable and enough rows."""
        super().check(inputs)
        if inputs.table is None:
            raise ValueError('table: missing; sampler "list" draws its rows; add table = {file = "..."}')
        columns = inputs.table.columns
        if columns is None:  # the file has not been read yet
            return
        check_names(inputs, "table.columns", list(columns), list(inputs.variables), "add its column")
        check_bounds(inputs, "table.columns", columns)
        rows = len(next(iter(columns.values())))
        if inputs.samples > rows:
            raise ValueError(f"samples = {inputs.samples}: the table has {rows} rows; write samples = {rows} or fewer")

    def draw(self, inputs: SampledInputs, first: int, count: int) -> dict[str, Array]:
        """Return rows of the table; ValueError if its file has not been read."""
        columns = inputs.table.columns if inputs.table else None
        if columns is None:
            raise ValueError("the rows of the table have not been read; load the campaign from its file")
        return {name: np.array(columns[name][first : first + count]) for name in inputs.variables}
