"""The results of a campaign: its rows as pandas tables, and the questions that one can ask about them."""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.store import Store, open_store
from clearcap.analysed import Analysed, flat, framed, numeric, units_of
from engine.mechanism import library_names
from reporting.write import USUAL

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from distributed import Client

    from campaign.cluster.cluster import Cluster
    from campaign.spec.load import Campaign, Source
    from clearcap.questions.confirmation import Confirmation
    from clearcap.questions.pooling import Member
    from clearcap.questions.samples import ReplayedSample
    from clearcap.questions.tolerances import Costs
    from clearcap.running import Progress
    from reporting.analysis import Analysis
    from reporting.tolerance.allocation import Allocation

_ESTIMATES = ("mean", "std", "cp", "cpk", "ppm")


@dataclass(frozen=True)
class Results(Analysed):
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
        return units_of(self.plan.schema)

    @cached_property
    def statuses(self) -> dict[str, int]:
        """Number of runs with each status."""
        return dict(self.store.survey(self.plan).statuses)

    @cached_property
    def rows(self) -> "pd.DataFrame":
        """One row per sample: variables, responses, and the status, message and certificate of its run.

        The index is the sample number. A response is NaN unless the run is ok. Units are in ``rows.attrs["units"]``.
        """
        return framed(self.store.table(self.id), "sample")

    @cached_property
    def ok(self) -> "pd.DataFrame":
        """The rows of the runs with status "ok", variables and responses only."""
        return self.rows.loc[self.rows["status"] == "ok", [*self.variables, *self.responses]]

    def to_xarray(self) -> "xr.Dataset":
        """Return `rows` as an xarray Dataset; needs ``pip install 'clearcap[xarray]'``.

        Returns
        -------
        xarray.Dataset
            One array per column, over the coordinate ``sample``. Attributes of each: ``units``, if it has a unit, and
            of responses with a title, ``long_name``.
        """
        try:
            import xarray as xr
        except ModuleNotFoundError as error:
            raise SpecError("to_xarray needs the package xarray: pip install 'clearcap[xarray]'") from error
        found = xr.Dataset.from_dataframe(self.rows)
        for name, unit in self.units.items():
            found[name].attrs["units"] = unit
        for name, response in self.plan.mechanism.responses.items():
            if response.title:
                found[name].attrs["long_name"] = response.title
        found.attrs = {"campaign": self.id, "title": self.plan.spec.title}
        return found

    @cached_property
    def _analysis(self) -> "Analysis":
        from clearcap.questions.report import analysis

        return analysis(self.store, self.plan)

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
            (``refusal``). ``ppm_expected`` is the share of a normal distribution, ``emulated`` says why an emulator of
            the rows gives the numbers, and not their weights.

        Raises
        ------
        SpecError
            If a setting is not allowed.
        CampaignError
            If the campaign has no samples.
        """
        import pandas as pd

        from clearcap.questions.whatif import what_if

        rows: dict[str, dict[str, Any]] = {}
        for name, answer in what_if(self.store, self.plan, list(settings)).items():
            row = rows.setdefault(name, {})
            for key in _ESTIMATES:
                estimate = getattr(answer, key)
                low, high = estimate.interval if estimate else (None, None)
                row |= {key: estimate and estimate.value, f"{key}_interval_low": low, f"{key}_interval_high": high}
            row |= {"ppm_expected": answer.ppm_expected, "samples_worth": answer.effective}
            row |= {"refusal": answer.refusal, "emulated": answer.emulated}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("response")

    def advise(self) -> "pd.DataFrame":
        """Return how far each spread must shrink, or may grow, while the other variables stay as they are.

        Returns
        -------
        DataFrame
            One row per variable for each response below its target, named in ``lifts``, and one, without such a name,
            for how far it may grow while all others keep theirs: factor on the present sigma with the ends of its
            interval, the response that limits it, its Cpk then, what to write into the campaign file, and by which
            method, or why there is no answer. What to do with each response is in ``attrs["remedies"]``.

        Raises
        ------
        CampaignError
            If no response has limits, or the campaign has no samples.
        """
        import pandas as pd

        from clearcap.questions.report import advice_of

        found, rows = advice_of(self.store, self.plan), []
        advised = [(s.response, (*s.alone, *((s.together,) if s.together else ()))) for s in found.shortfalls]
        for lifts, of_variables in [*advised, ("", found.growth)]:
            for each in of_variables:
                write, method = " ".join(each.written or each.settings), each.refusal or each.method
                ends = (each.factor, *each.interval, each.binding, each.cpk, write, method)
                rows.append((lifts, each.variable, *ends))
        columns = ["lifts", "variable", "factor", "factor_low", "factor_high", "limited_by", "cpk", "write", "method"]
        frame = numeric(pd.DataFrame(rows, columns=columns).set_index(columns[:2]))
        frame.attrs |= {"remedies": {each.response: each.text for each in found.shortfalls}, "note": found.note}
        return frame

    def allocate(self, costs: "str | Path | Mapping[str, Any]") -> "Allocation":
        """Return the cheapest standard deviations with which every response meets its target.

        Parameters
        ----------
        costs : str, Path or mapping
            A cost file, or its tables: what each variable costs (docs/report.md).

        Returns
        -------
        Allocation
            ``tolerances``, ``factors``, ``cost``, ``cost_now``, ``responses``, ``written``; or why there is none, in
            ``refusal``.

        Raises
        ------
        SpecError, CampaignError
            If the costs have faults, or the samples give no answer.
        """
        from clearcap.questions.tolerances import cheapest_tolerances

        return cheapest_tolerances(self.store, self.plan, self._costs(costs))

    def _costs(self, costs: "str | Path | Mapping[str, Any]") -> "Costs":
        from clearcap.questions.tolerances import costs_of, read_costs

        if isinstance(costs, Mapping):
            return costs_of(costs, self.plan, "costs:")
        return read_costs(Path(costs), self.plan)

    def confirm(
        self,
        costs: "str | Path | Mapping[str, Any]",
        *,
        workers: int | None = None,
        cluster: "Cluster | Client | None" = None,
        progress: "Progress" = True,
    ) -> "Confirmation":
        """Judge the cheapest standard deviations by fresh runs of the simulator, which are computed here.

        If a response misses its target there, or a tolerance had to stop where the rows do, the fresh rows propose the
        next set, in at most four rounds. The same call again computes nothing that is complete.

        Parameters
        ----------
        costs : str, Path or mapping
            As of `allocate`.
        workers, cluster, progress
            As of `clearcap.run_campaign`.

        Returns
        -------
        Confirmation
            ``outcome``: "confirmed", "missed" or "refused"; ``text``, the same in a sentence; ``proposal``, the last
            `Allocation`; ``rounds``, each with its ``proposal``, the ``campaign`` of its fresh runs, and ``responses``:
            Cpk as promised and as computed, with intervals.

        Raises
        ------
        SpecError, CampaignError, UnreachableError, StoreError
            As of `allocate` and `clearcap.run_campaign`.
        """
        from campaign.cluster.cluster import Cluster
        from clearcap.questions.confirmation import confirm
        from clearcap.running import compute

        options = [*Cluster.of(cluster, workers).options(), "--no-decide"]

        def computes(fresh: Plan) -> None:
            compute(self.store, fresh, "resume", options, progress)

        return confirm(self.store, self.plan, self._costs(costs), computes)

    def replay(self, sample: int, motion: str | Path | None = None, *, halved: bool = False) -> "ReplayedSample":
        """Compute a sample again, here, and compare it with its stored row, bit for bit.

        Parameters
        ----------
        sample : int
            Number of the sample.
        motion : str or Path, optional
            HDF5 file to write its motion to, for `read_trajectory`.
        halved : bool
            Compute its repeat with half the step instead.

        Raises
        ------
        SpecError
            If the campaign has no such sample.
        """
        from clearcap.questions.samples import replay_sample

        path = None if motion is None else Path(motion)
        return replay_sample(self.store, self.id, sample, path, halved=halved)

    def compare(self, other: "Results") -> "pd.DataFrame":
        """Return how each response differs from that of another campaign: this one less the other.

        Returns
        -------
        DataFrame
            One row per response of both: difference of the means, ratio of the sigmas and difference of Cpk, each with
            the ends of its interval, and the tests. What differs in the plans is a table in ``attrs["plans"]``.

        Raises
        ------
        CampaignError
            If they have no response in common, or one of them has no samples.
        """
        import pandas as pd

        from clearcap.questions.plan_differences import plan_differences
        from clearcap.questions.report import comparison

        found = comparison((self.store, self.plan), (other.store, other.plan))
        left_out = ("response", "capability", "capability_other", "histogram", "histogram_other", "notes")
        rows = {}
        for each in found.responses:
            own = {"mean": each.capability.mean, "mean_other": each.capability_other.mean}
            own |= {"cpk": each.capability.cpk, "cpk_other": each.capability_other.cpk}
            rows[each.response] = own | flat(vars(each), left_out)
        frame = numeric(pd.DataFrame.from_dict(rows, orient="index").rename_axis("response"))
        differs = plan_differences(self.store, self.id, other.store, other.id)
        frame.attrs |= {"plans": pd.DataFrame(map(asdict, differs)), "no_verdict": found.no_verdict}
        return frame

    def pool(self, *others: "Results") -> "PooledResults":
        """Return these samples and those of other campaigns that differ only in seed and number of samples, as one.

        Raises
        ------
        SpecError
            If the plans differ in anything else, two have one seed, a sampler draws no independent samples, or
            builds differ: the message names the first difference.
        """
        return PooledResults((self, *others))

    def design(self, samples: int = 20_000, responses: Collection[str] = ()) -> dict[str, Any]:
        """Return the tables of a campaign that aims where these rows expect rejects, for `run_campaign`.

        Parameters
        ----------
        samples : int
            Number of its samples.
        responses : collection of str
            Aim at the limits of these responses only; by default at all.

        Raises
        ------
        SpecError, CampaignError
            If no response has limits, or the rows do not show where rejects lie.
        """
        from clearcap.questions.decision import aimed_campaign

        tables = aimed_campaign(self.store, self.plan, samples, list(responses)).tables
        if self.plan.spec.mechanism in library_names():
            return tables
        own = {key: value for key, value in tables.items() if key not in ("bench", "preset")}  # it has them already
        return own | {"mechanism": self.plan.mechanism}

    def repeat(
        self,
        share: float = 0.1,
        *,
        workers: int | None = None,
        cluster: "Cluster | Client | None" = None,
        progress: "Progress" = True,
    ) -> "Results":
        """Repeat samples with half the step, so that the report tells how far results depend on it.

        Parameters
        ----------
        share : float
            Share of the samples, from 0 to 1, counting those that are repeated already.
        workers, cluster, progress
            As in `run_campaign`, whose errors it raises.

        Returns
        -------
        Results
            The results, read again.
        """
        from campaign.cluster.cluster import Cluster
        from clearcap.running import compute

        if not 0 <= share <= 1:
            raise SpecError(f"share = {share!r:.40}; allowed: from 0 to 1")
        where = Cluster.of(cluster, workers)
        compute(self.store, self.plan, "repeat", ["--share", f"{share:.17g}", *where.options()], progress)
        return Results(self.store, self.plan)

    def report(self, *kinds: str) -> dict[str, str]:
        """Write the report into the store and return the path or URL of each file by kind; see `clearcap.report`."""
        return report(self, kinds or USUAL)

    def __repr__(self) -> str:
        """Return id, samples and store in a line; nothing is read for it."""
        return f"<Results {self.id}: {self.plan.spec.samples} samples in {self.store.url}>"

    def _repr_html_(self) -> str:
        counts = ", ".join(f"{count} {status}" for status, count in self.statuses.items())
        lines = (self.plan.title, f"campaign {self.id} in {self.store.url}", f"runs: {counts or 'none yet'}")
        return "<br>".join(map(escape, lines))


@dataclass(frozen=True)
class PooledResults(Analysed):
    """The samples of several campaigns that differ only in seed and number of samples; see `Results.pool`.

    ``capability``, ``sensitivity`` and ``plot`` are those of one campaign that had drawn all the samples.

    Attributes
    ----------
    members : tuple of Results
        The campaigns.
    """

    members: tuple[Results, ...]

    def __post_init__(self) -> None:
        """Raise SpecError unless the campaigns can be pooled."""
        from clearcap.questions.pooling import pooled

        pooled(self._plans)

    @property
    def _plans(self) -> "list[Member]":
        return [(each.store, each.plan) for each in self.members]

    @cached_property
    def rows(self) -> "pd.DataFrame":
        """The rows of all, with the campaign's id and the number of the sample in it as index."""
        import pandas as pd

        rows = pd.concat({each.id: each.rows for each in self.members}, names=["campaign"])
        rows.attrs["units"] = self.members[0].units
        return rows

    @cached_property
    def _analysis(self) -> "Analysis":
        from clearcap.questions.pooling import pooled_analysis

        return pooled_analysis(self._plans)

    def report(self, *kinds: str) -> dict[str, str]:
        """Write the report into ``pooled/`` of the first campaign, as `clearcap.report`; return each file by kind."""
        from clearcap.questions.pooling import pooled_report

        return pooled_report(self._plans, kinds or USUAL)

    def __repr__(self) -> str:
        """Return the campaigns in a line; nothing is read for it."""
        said = ", ".join(f"{each.id} ({each.plan.spec.samples} samples)" for each in self.members)
        return f"<PooledResults {said}>"

    def _repr_html_(self) -> str:
        title = f"{self.members[0].plan.title}, pooled"
        return "<br>".join((escape(title), *(each._repr_html_() for each in self.members)))


def run_campaign(
    campaign: "Source | Campaign",
    *,
    samples: int | None = None,
    seed: int | None = None,
    store: str | Path = "runs",
    workers: int | None = None,
    cluster: "Cluster | Client | None" = None,
    progress: "Progress" = True,
    decide: bool = True,
) -> Results:
    """Run a campaign until it is complete and return its results.

    A second call continues where an earlier one stopped, and computes nothing if the campaign is complete. The campaign
    runs in a separate process, as with ``clearcap run``, so a script needs no ``__main__`` guard.

    Parameters
    ----------
    campaign : str, Path, mapping or Campaign
        Name of a shipped campaign, path of a file, its tables as a dict, whose ``mechanism`` may be a `Mechanism`, or
        what `load_campaign` returned.
    samples, seed : int, optional
        Instead of the campaign's own.
    store : str or Path
        Folder or URL of the store.
    workers : int, optional
        Number of worker processes on this machine; by default one per core.
    cluster : Cluster or distributed.Client, optional
        Where to compute instead of on this machine: it has workers of its own.
    progress : bool or callable
        Write a line to `sys.stderr` every ten seconds; or a function, called here with each `Heartbeat`, every two
        seconds. What it raises ends the run. If it has a method ``rows``, that is called with tables of finished rows,
        as in `Results.rows`, each row once, those of an earlier run too.
    decide : bool
        Compute further runs for verdicts that the samples leave open, as many as the campaign's ``decide`` allows.

    Returns
    -------
    Results
        One row per sample. A warning is issued if too few runs are ok, or none.

    Raises
    ------
    SpecError
        If the campaign, the address of the store or the cluster is wrong; nothing was computed.
    UnreachableError, StoreError
        If the cluster or the store keeps failing. Stored rows are kept, and the same call continues.
    CampaignError
        If the campaign cannot be completed, for instance because too many runs fail.
    KeyboardInterrupt
        On Ctrl-C. The same call continues the campaign.
    """
    from campaign.store.layout import CANCEL
    from clearcap.running import compute

    opened, plan, options = planned(campaign, samples, seed, store, workers, cluster)
    opened.remove(plan.campaign_id, CANCEL)
    compute(opened, plan, "resume", [*options, "--decide" if decide else "--no-decide"], progress)
    return Results(opened, plan)


def planned(
    campaign: "Source | Campaign",
    samples: int | None,
    seed: int | None,
    store: str | Path,
    workers: int | None,
    cluster: "Cluster | Client | None",
) -> tuple[Store, Plan, list[str]]:
    """Return the store with the plan of a campaign, and the options that say where it is computed; SpecError."""
    from campaign.cluster.cluster import Cluster
    from campaign.coordinator.submit import plan_campaign
    from campaign.spec.load import Campaign

    if cluster is not None and workers is not None:
        raise SpecError(f"workers = {workers} and a cluster are given; name the workers in the cluster")
    if isinstance(campaign, Campaign) and (samples is not None or seed is not None):
        raise SpecError("samples and seed belong to load_campaign where the campaign is loaded already")
    where = Cluster.of(cluster, workers)
    return *plan_campaign(campaign, str(store), samples, seed), where.options()


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
