"""The results of a campaign as tables of pandas."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from campaign.plan import Plan
from campaign.store import Store, open_store
from reporting.write import USUAL

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from reporting.tolerance.whatif import WhatIf

_ESTIMATES = ("mean", "std", "cp", "cpk", "ppm")


@dataclass(frozen=True)
class Results:
    """A campaign in a store. Tables are read once, at their first use; `open_campaign` reads a growing one anew.

    Attributes
    ----------
    store : Store
        Where the rows are.
    plan : Plan
        What is computed: ``plan.spec`` is the campaign, ``plan.mechanism`` the mechanism.
    """

    store: Store
    plan: Plan

    @property
    def id(self) -> str:
        """The campaign's id: its folder in the store, and what the verbs of the command take."""
        return self.plan.campaign_id

    @property
    def variables(self) -> list[str]:
        """Names of what varies."""
        return list(self.plan.spec.variables)

    @property
    def responses(self) -> list[str]:
        """Names of what is measured."""
        return list(self.plan.mechanism.responses)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column of `rows`, where it has one."""
        return _units(self.plan.schema)

    @cached_property
    def statuses(self) -> dict[str, int]:
        """How many runs ended with each status."""
        return dict(self.store.survey(self.plan).statuses)

    @cached_property
    def rows(self) -> "pd.DataFrame":
        """One row a sample: variables, responses, status, message and certificate of its run.

        The index is the sample number. A response is NaN unless the run is ok. Units are in ``rows.attrs["units"]``.
        """
        return _frame(self.store.table(self.id), "sample")

    @cached_property
    def ok(self) -> "pd.DataFrame":
        """The rows of the runs that are ok, variables and responses only."""
        return self.rows.loc[self.rows["status"] == "ok", [*self.variables, *self.responses]]

    @cached_property
    def capability(self) -> "pd.DataFrame":
        """One row a response: verdict, indices, intervals and shares, equal to those of the report.

        Raises
        ------
        CampaignError
            If the store has no row of the campaign.
        """
        from campaign.reports.report import analysis
        from reporting.render.parquet import capability_table

        return _frame(capability_table(analysis(self.store, self.plan)), "response")

    def what_if(self, *settings: str) -> "pd.DataFrame":
        """Return the responses under other distributions of the variables, without new runs.

        Parameters
        ----------
        *settings : str
            As of ``clearcap whatif --set``, for instance ``"J1.std=0.01"``.

        Returns
        -------
        DataFrame
            One row a response: mean, std, cp, cpk and ppm with the ends of their intervals (``cpk_interval_low``,
            ``cpk_interval_high``), the number of samples that the answer rests on, and why there is none (``refusal``).

        Raises
        ------
        SpecError
            If a setting is not possible.
        CampaignError
            If there are no samples.
        """
        import pandas as pd

        from campaign.reports.whatif import what_if

        answers = what_if(self.store, self.plan, list(settings))
        rows = {name: _answer(answer) for name, answer in answers.items()}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("response")

    def report(self, *kinds: str) -> dict[str, str]:
        """Write the report into the store; see `clearcap.report`."""
        return report(self, kinds or USUAL)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        counts = ", ".join(f"{count} {status}" for status, count in self.statuses.items())
        lines = (self.plan.title, f"campaign {self.id} in {self.store.url}", f"runs: {counts or 'none yet'}")
        return "<br>".join(map(escape, lines))


def open_campaign(campaign_id: str | None = None, store: str | Path = "runs") -> Results:
    """Return the results of a campaign that a store has, also while it is computed.

    Parameters
    ----------
    campaign_id : str, optional
        Its id; not needed if the store holds only one campaign.
    store : str or Path
        Folder or URL of the store.

    Raises
    ------
    SpecError
        If there is no such campaign.
    StoreError
        If its plan cannot be read.
    """
    opened = open_store(str(store))
    return Results(opened, opened.plan(opened.find(campaign_id)))


def report(results: Results, kinds: Collection[str] = USUAL) -> dict[str, str]:
    """Write the report of a campaign into its folder of the store.

    Parameters
    ----------
    results : Results
        The campaign.
    kinds : collection of str
        Files to write: "html", "json", "parquet", "xlsx" (extra ``clearcap[excel]``), "pdf" (extra ``clearcap[pdf]``).

    Returns
    -------
    dict of str to str
        Path or URL of each file by kind.

    Raises
    ------
    CampaignError
        If there is nothing to report on.
    StoreError, SpecError
        If it cannot be written.
    """
    from campaign.reports.report import report as write

    return write(results.store, results.plan, kinds=kinds)


def _frame(table: "pa.Table", index: str) -> "pd.DataFrame":
    """Return a table of Arrow as one of pandas, with the units that pandas would lose."""
    frame: pd.DataFrame = table.to_pandas().set_index(index)
    frame.attrs["units"] = _units(table.schema)
    return frame


def _units(schema: "pa.Schema") -> dict[str, str]:
    """Return the units in the metadata of the columns."""
    return {f.name: f.metadata[b"unit"].decode() for f in schema if f.metadata and b"unit" in f.metadata}


def _answer(answer: "WhatIf") -> dict[str, Any]:
    """Return the numbers of an answer by column."""
    row: dict[str, Any] = {}
    for name in _ESTIMATES:
        estimate = getattr(answer, name)
        low, high = estimate.interval if estimate else (None, None)
        row |= {name: estimate and estimate.value, f"{name}_interval_low": low, f"{name}_interval_high": high}
    return row | {"samples_worth": answer.effective, "refusal": answer.refusal}
