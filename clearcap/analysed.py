"""What follows from the analysis of rows, of one campaign or of several as one: its tables and figures."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import asdict
from functools import cached_property
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from clearcap.result_plots import Plots
    from reporting.analysis import Analysis


class Analysed(ABC):
    """Rows with an analysis: the numbers and figures of their report."""

    @property
    @abstractmethod
    def _analysis(self) -> "Analysis": ...

    @cached_property
    def capability(self) -> "pd.DataFrame":
        """One row per response: verdict, indices, intervals and shares, equal to those in the report.

        Raises
        ------
        CampaignError
            If the store holds no row of the campaign.
        """
        from reporting.render.data_files import capability_table

        return framed(capability_table(self._analysis), "response")

    @cached_property
    def sensitivity(self) -> "pd.DataFrame":
        """One row per response and variable: share of the variance, Sobol' indices, regression, verdict.

        Raises
        ------
        CampaignError
            If the store holds no row of the campaign.
        """
        import pandas as pd

        rows = [
            {"response": response.spec.name, "share": each.share, **flat(asdict(each), ("curve", "through"))}
            for response in self._analysis.responses
            if response.sensitivity
            for each in response.sensitivity.influences
        ]
        columns = ["response", "variable", "share"]
        return numeric(pd.DataFrame(rows, columns=None if rows else columns).set_index(columns[:2]))

    @property
    def plot(self) -> "Plots":
        """The report's figures on matplotlib axes: ``histogram``, ``probability``, ``causes`` and ``convergence``."""
        from clearcap.result_plots import Plots

        return Plots(lambda: self._analysis)


def framed(table: "pa.Table", index: str) -> "pd.DataFrame":
    """Return an Arrow table as a pandas table, with the units that pandas would lose."""
    found: pd.DataFrame = table.to_pandas().set_index(index)
    found.attrs["units"] = units_of(table.schema)
    return found


def units_of(schema: "pa.Schema") -> dict[str, str]:
    """Return the unit of each column that has one."""
    return {f.name: f.metadata[b"unit"].decode() for f in schema if f.metadata and b"unit" in f.metadata}


def numeric(table: "pd.DataFrame") -> "pd.DataFrame":
    """Return a table with NaN in the place of None, in columns that hold nothing but numbers."""
    for name in table.columns:
        if all(value is None or type(value) in (int, float) for value in table[name]):
            table[name] = table[name].astype(float)
    return table


def flat(fields: Mapping[str, Any], left_out: Collection[str]) -> dict[str, Any]:
    """Return fields with two columns for each interval."""
    row: dict[str, Any] = {}
    for name, value in fields.items():
        if name in left_out:
            continue
        if name.endswith("_interval"):
            row[f"{name}_low"], row[f"{name}_high"] = value or (None, None)
        else:
            row[name] = value
    return row
