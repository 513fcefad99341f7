"""The results of a campaign as pandas tables."""

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
    """The results of a campaign in a store, read once.

    Each table is read when it is first used and then kept. Call `open_campaign` again to see new rows of a campaign
    that is still running.

    Attributes
    ----------
    store : Store
        Where the rows are stored.
    plan : Plan
        What the campaign computes: ``plan.spec`` is the campaign, ``plan.mechanism`` the mechanism.
    """

    store: Store
    plan: Plan

    @property
    def id(self) -> str:
        """The campaign's id: the name of its folder in the store, and the argument of the ``clearcap`` subcommands."""
        return self.plan.campaign_id

    @property
    def variables(self) -> list[str]:
        """Names of the variables: the inputs that vary."""
        return list(self.plan.spec.variables)

    @property
    def responses(self) -> list[str]:
        """Names of the responses: the functional conditions that are measured."""
        return list(self.plan.mechanism.responses)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column of `rows` that has one."""
        return _units(self.plan.schema)

    @cached_property
    def statuses(self) -> dict[str, int]:
        """Number of runs with each status."""
        return dict(self.store.survey(self.plan).statuses)

    @cached_property
    def rows(self) -> "pd.DataFrame":
        """One row per sample: variables, responses, and the status, message and certificate of its run.

        The index is the sample number. A response is NaN unless the run is ok. Units are in ``rows.attrs["units"]``.
        """
        return _frame(self.store.table(self.id), "sample")

    @cached_property
    def ok(self) -> "pd.DataFrame":
        """The rows of the runs with status "ok", variables and responses only."""
        return self.rows.loc[self.rows["status"] == "ok", [*self.variables, *self.responses]]

    @cached_property
    def capability(self) -> "pd.DataFrame":
        """One row per response: verdict, indices, intervals and shares, equal to those in the report.

        Raises
        ------
        CampaignError
            If the store holds no row of the campaign.
        """
        from clearcap.questions.report import analysis
        from reporting.render.parquet import capability_table

        return _frame(capability_table(analysis(self.store, self.plan)), "response")

    def what_if(self, *settings: str) -> "pd.DataFrame":
        """Return the responses predicted for other distributions of the variables, without new runs.

        Parameters
        ----------
        *settings : str
            Settings in the syntax of ``clearcap whatif --set``, for instance ``"J1.std=0.01"``.

        Returns
        -------
        DataFrame
            One row per response: mean, std, cp, cpk and ppm with the ends of their intervals (``cpk_interval_low``,
            ``cpk_interval_high``), the number of samples behind the answer, and the reason if there is none
            (``refusal``).

        Raises
        ------
        SpecError
            If a setting is not allowed.
        CampaignError
            If the campaign has no samples.
        """
        import pandas as pd

        from clearcap.questions.whatif import what_if

        answers = what_if(self.store, self.plan, list(settings))
        rows = {name: _answer(answer) for name, answer in answers.items()}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("response")

    def report(self, *kinds: str) -> dict[str, str]:
        """Write the report into the store and return the path or URL of each file by kind; see `clearcap.report`."""
        return report(self, kinds or USUAL)

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows."""
        counts = ", ".join(f"{count} {status}" for status, count in self.statuses.items())
        lines = (self.plan.title, f"campaign {self.id} in {self.store.url}", f"runs: {counts or 'none yet'}")
        return "<br>".join(map(escape, lines))


def open_campaign(campaign_id: str | None = None, store: str | Path = "runs") -> Results:
    """Return the results of a campaign in a store; the campaign may still be running.

    Parameters
    ----------
    campaign_id : str, optional
        Id of the campaign; not needed if the store holds only one.
    store : str or Path
        Folder or URL of the store.

    Raises
    ------
    SpecError
        If the store has no such campaign.
    StoreError
        If the campaign's plan cannot be read.
    """
    opened = open_store(str(store))
    return Results(opened, opened.plan(opened.find(campaign_id)))


def report(results: Results, kinds: Collection[str] = USUAL) -> dict[str, str]:
    """Write the report of a campaign into its folder of the store.

    Parameters
    ----------
    results : Results
        The results of the campaign.
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
        If the report cannot be written.
    """
    from clearcap.questions.report import report as write

    return write(results.store, results.plan, kinds=kinds)


def _frame(table: "pa.Table", index: str) -> "pd.DataFrame":
    """Return an Arrow table as a pandas table, with the units that pandas would lose."""
    frame: pd.DataFrame = table.to_pandas().set_index(index)
    frame.attrs["units"] = _units(table.schema)
    return frame


def _units(schema: "pa.Schema") -> dict[str, str]:
    """Return the units from the metadata of the columns."""
    return {f.name: f.metadata[b"unit"].decode() for f in schema if f.metadata and b"unit" in f.metadata}


def _answer(answer: "WhatIf") -> dict[str, Any]:
    """Return the numbers of a what-if answer by column name."""
    row: dict[str, Any] = {}
    for name in _ESTIMATES:
        estimate = getattr(answer, name)
        low, high = estimate.interval if estimate else (None, None)
        row |= {name: estimate and estimate.value, f"{name}_interval_low": low, f"{name}_interval_high": high}
    return row | {"samples_worth": answer.effective, "refusal": answer.refusal}
