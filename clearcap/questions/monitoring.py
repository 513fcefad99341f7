"""Measured lots become the distributions of a campaign's variables; its rows, weighted for them, give the indices now.

Each variable gets the simplest of the families that fit, among those that a campaign draws from. Where the campaign has
lots for a variable, and so has the table, the scatter between lots becomes that of the campaign's lots, and the family
is that of the values within them.
"""

import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from campaign.errors import SpecError
from campaign.inputs.distributions import Continuous, Distribution
from campaign.plan import Plan
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import QUICK
from campaign.store.monitored_library import (
    Monitored,
    MonitoredIndex,
    MonitoredVariable,
    add_monitored,
    read_monitored,
)
from clearcap.questions.measured import asked_of_parts, limits_of_columns
from clearcap.questions.measurement_table import LARGEST_TABLE
from clearcap.questions.report_source import sha256
from clearcap.questions.submissions import Capacity, submit_changed
from clearcap.questions.uploaded_parts import own_folder
from clearcap.questions.whatif import changed_variables, check_drawn, what_if
from engine.mechanism import unit_of
from engine.platform.regular_file import read_regular_file
from reporting import ReportError
from reporting.arrays import Array
from reporting.capability.lots import variance_components
from reporting.capability.verdict import CAPABLE
from reporting.samples import read_samples
from reporting.shape.fitting import Fit, fit_families
from reporting.tolerance.reweighting import EstimatedDistribution, estimated_distribution
from reporting.tolerance.whatif import Estimate, WhatIf

if TYPE_CHECKING:
    import pandas as pd

FEWEST = 20  # values of a variable
FEWEST_LOTS = 5
MOST_BEYOND = 0.01  # probability that a fitted distribution may have beyond the bounds of the campaign's
FEWEST_REJECTS = 10.0  # weighted, from which on their share says more than Cpk
_QUANTILES = 2000
_NAMED = {  # of a family: the distribution of a campaign, and its keys by the names of the parameters
    "normal": ("normal", {"mean": "mean", "sd": "std"}),
    "lognormal": ("lognormal", {"mean of log": "log_mean", "sd of log": "log_std"}),
    "weibull": ("weibull", {"shape": "shape", "scale": "scale"}),
    "gamma": ("gamma", {"shape": "shape", "scale": "scale"}),
    "exponential": ("exponential", {"scale": "scale"}),
    "weibull_above": ("weibull", {"low": "origin", "shape": "shape", "scale": "scale"}),
    "gamma_above": ("gamma", {"low": "origin", "shape": "shape", "scale": "scale"}),
    "johnson_sl": ("lognormal", {"low": "origin", "mean of log": "log_mean", "sd of log": "log_std"}),
}
_SKEWED = ("lognormal", "weibull", "gamma", "exponential")  # they have an origin


def monitor_campaign(
    parts: "str | Path | pd.DataFrame",
    campaign_id: str | None = None,
    store: str | Path = "runs",
    limits: Any = None,
    *,
    rerun: bool = False,
) -> Monitored:
    """Return the indices of a campaign's responses under the distributions that measured parts have, and keep them.

    Parameters
    ----------
    parts : str, Path or pandas.DataFrame
        The measurements, one row a part: a CSV, Parquet or Excel file, or a table. Without `limits`, columns with the
        name of a variable are taken, in the unit of the variable.
    campaign_id : str, optional
        Id of the campaign; not needed if the store holds only one.
    store : str or Path
        Folder or URL of the store.
    limits : str, Path or mapping, optional
        Limits file of the parts, whose characteristics have the names of variables; it may name columns and lots.
    rerun : bool
        Whether a campaign with the new distributions is queued where the rows give no answer.

    Returns
    -------
    Monitored
        The new distribution of each variable, and the index of each response with limits.

    Raises
    ------
    SpecError
        The table or the limits do not fit the campaign, or no distribution fits any variable.
    CampaignError
        The campaign has no rows.
    """
    opened = open_store(str(store))
    return monitored(opened, opened.plan(opened.find(campaign_id)), parts, limits, rerun=rerun)


def monitored(
    store: Store,
    plan: Plan,
    parts: "str | Path | pd.DataFrame",
    limits: Any = None,
    *,
    rerun: bool = False,
    by: str = "",
    capacity: Capacity | None = None,
) -> Monitored:
    """Return what `monitor_campaign` returns, of an open store."""
    check_drawn(plan.spec)
    before = read_monitored(store, plan.campaign_id)
    found = _measured_variables(plan, parts, limits)
    settings = [setting for _, those, _ in found for setting in those]
    if not settings:
        reasons = "; ".join(f"{each.variable}: {each.note}" for each, *_ in found)
        raise SpecError(f"parts: no variable gets a new distribution: {reasons}")
    changed = changed_variables(plan.spec, settings).variables
    estimated = {
        each.variable: _estimated(changed.get(each.variable, plan.spec.variables[each.variable]), values)
        for each, those, values in found
        if those
    }
    limited = [name for name in plan.mechanism.responses if _is_limited(plan, name)]
    answers = what_if(store, plan, settings, estimated, limited) if limited else {}
    indices = [_index(plan, name, each) for name, each in answers.items()]
    other = None
    if rerun and any(each.refusal for each in indices):
        other = submit_changed(store, plan, changed, by, capacity or Capacity()).campaign
    content = read_regular_file(parts, LARGEST_TABLE) if isinstance(parts, str | Path) else None
    new = Monitored(
        number=1,
        at=time.time(),
        by=by,
        table=Path(parts).name if isinstance(parts, str | Path) else "",
        sha256="" if content is None else sha256(content),
        settings=settings,
        variables=[_worded(each, plan.spec.variables, changed) for each, *_ in found],
        responses=indices,
        campaign=other,
    )
    return add_monitored(store, plan.campaign_id, new, before)


def monitor_in_store(
    store: str,
    campaign_id: str,
    table: Path,
    file: str,
    limits: Path | None,
    by: str,
    rerun: bool,
    capacity: Capacity,
) -> dict[str, Any]:
    """Return the `Monitored` of a table that was sent to a server, as data; for a process of its own."""
    opened = open_store(store, QUICK)
    with own_folder(table, file, limits) as (name, of_limits):
        found = monitored(opened, opened.plan(campaign_id), name, of_limits, rerun=rerun, by=by, capacity=capacity)
    return found.model_dump()


# -- measured values become distributions ------------------------------------------------------------------------------


_Values = tuple[Array, NDArray[np.generic] | None]  # of the parts, and their lots


def _measured_variables(
    plan: Plan, parts: "str | Path | pd.DataFrame", limits: Any
) -> list[tuple[MonitoredVariable, list[str], _Values]]:
    """Return what the parts say of each variable, the settings that make it the campaign's, and their values."""
    variables, targets = plan.spec.variables, plan.spec.targets()
    units = {name: unit_of(plan.mechanism, targets[name]) for name in variables}
    table, spec = asked_of_parts(parts, limits_of_columns(parts, units, "variable") if limits is None else limits)
    if foreign := [each.name for each in spec.responses if each.name not in variables]:
        words = f"the campaign has no such variable; allowed: {', '.join(variables)}"
        raise SpecError(f"characteristics.{foreign[0]}: {words}")
    for each in spec.responses:
        if each.unit not in ("1", units[each.name]):
            where = f'characteristics.{each.name}.unit = "{each.unit}"'
            raise SpecError(f"{where}: the variable is in {units[each.name]}; convert the values")
    try:
        samples = read_samples(table, spec)
    except ReportError as error:
        raise SpecError(f"parts: {error}") from error
    found = list[tuple[MonitoredVariable, list[str], _Values]]()
    for each in spec.responses:
        x = samples.values[each.name]
        finite = np.isfinite(x)
        lots = None if samples.production_batch is None else samples.production_batch[finite]
        found.append((*_updated(each.name, variables[each.name], x[finite], lots), (x[finite], lots)))
    return found


def _estimated(now: Distribution, values: _Values) -> EstimatedDistribution:
    """Return how well the parts tell the distribution that they got."""
    x, lots = values
    lots = lots if lots is not None and np.unique(lots).size > 1 else None
    return estimated_distribution(now.moments(), now.ppf((np.arange(_QUANTILES) + 0.5) / _QUANTILES), x, lots)


def _updated(
    name: str, old: Distribution, x: Array, lots: NDArray[np.generic] | None
) -> tuple[MonitoredVariable, list[str]]:
    """Return the distribution of measured values as the settings of a variable; none if there is a reason not to."""
    count = None if lots is None else int(np.unique(lots).size)
    base = MonitoredVariable(variable=name, parts=x.size, lots=count, before=old.text())

    def stays(why: str) -> tuple[MonitoredVariable, list[str]]:
        return base.model_copy(update={"note": why}), []

    if not isinstance(old, Continuous):
        return stays(f"it stays: its distribution in the campaign has no density ({old.text()})")
    if x.size < FEWEST:
        return stays(f"it stays: {x.size} values are too few; {FEWEST} are needed")
    within, batch, notes = x, list[str](), list[str]()
    if old.batch is not None and lots is not None and count is not None:
        if count < FEWEST_LOTS or x.size - count < FEWEST:
            return stays(f"it stays: {count} lots are too few for their scatter; {FEWEST_LOTS} are needed")
        within, scatter = _within_lots(x, lots)
        batch = [f"{name}.batch.std={scatter!r}"] if scatter > 0 else [f"{name}.batch="]
        notes += [] if scatter > 0 else ["lots do not differ, so it has no lots any more"]
    elif lots is not None and count is not None and count > 1:
        share = _share_between(x, lots)
        notes.append(f"{100 * share:.0f} % of the variance is between lots, which the campaign does not draw")
    fits = fit_families(within, names=_NAMED)
    fit = fits.of(fits.best)
    if fit is None:
        return stays(f"it stays: {fits.notes[0] if fits.notes else 'no distribution fits'}")
    kind, keys = _NAMED[fit.family]
    low, high, words = _bounds(old, x, fit)
    notes += words
    table = {keys[parameter]: value for parameter, value in fit.parameters.items() if parameter in keys}
    if kind in _SKEWED:
        table.setdefault("origin", 0.0)
    if kind == "normal" and low is not None and high is not None:
        kind = "truncated_normal"
    settings = [f"{name}.distribution={json.dumps(kind)}", *(f"{name}.{key}={value!r}" for key, value in table.items())]
    settings += [f"{name}.{key}={_setting(value)}" for key, value in (("lower", low), ("upper", high))]
    known = base.model_copy(update={"family": fit.title, "p": fit.ad_p, "note": "; ".join(notes)})
    return known, settings + batch


def _setting(bound: float | None) -> str:
    return "" if bound is None else repr(bound)


def _within_lots(x: Array, lots: NDArray[np.generic]) -> tuple[Array, float]:
    """Return values as they would be in one lot of average place, and sigma between lots, at least 0."""
    _, number, counts = np.unique(lots, return_inverse=True, return_counts=True)
    means = np.bincount(number, x) / counts
    shifts = variance_components(x - x.mean(), lots).variance_between or 0.0
    widened = math.sqrt(x.size / (x.size - counts.size))  # each lot's own mean takes a degree of freedom
    return means.mean() + widened * (x - means[number]), math.sqrt(shifts)


def _share_between(x: Array, lots: NDArray[np.generic]) -> float:
    parts = variance_components(x - x.mean(), lots)
    between = parts.variance_between or 0.0
    total = between + (parts.within or 0.0)
    return between / total if total > 0 else 0.0


def _bounds(old: Continuous, x: Array, fit: Fit) -> tuple[float | None, float | None, list[str]]:
    """Return the bounds that the new distribution keeps, and what is to be said of those that it does not."""
    from reporting.shape.fitting import distribution

    fitted, found, notes = distribution(fit), list[float | None](), list[str]()
    low, high = old.cut()
    for end, value, tail, extreme in (
        ("lower", low, fitted.cdf, float(x.min())),
        ("upper", high, fitted.sf, float(x.max())),
    ):
        if not math.isfinite(value):
            found.append(None)
            continue
        beyond, share = (extreme < value if end == "lower" else extreme > value), float(tail(value))
        keeps = not beyond and share <= MOST_BEYOND
        found.append(value if keeps else None)
        if not keeps:
            why = f"a part has {extreme:.6g}" if beyond else f"{100 * share:.2g} % of the fit are beyond"
            notes.append(f"the campaign's {end} bound {value:g} does not hold: {why}")
    return found[0], found[1], notes


def _worded(
    each: MonitoredVariable, old: Mapping[str, Distribution], changed: Mapping[str, Distribution]
) -> MonitoredVariable:
    """Return a variable with its new distribution in words; one that gets none stays."""
    now = changed.get(each.variable, old[each.variable] if each.family else None)
    return each if now is None else each.model_copy(update={"now": now.text()})


# -- weighted rows become indices --------------------------------------------------------------------------------------


def _is_limited(plan: Plan, name: str) -> bool:
    response = plan.spec.responses.get(name)
    return response is not None and response.limits()[:2] != (None, None)


def _index(plan: Plan, name: str, answer: WhatIf) -> MonitoredIndex:
    """Return the index that decides: of the share of rejects if that is asked for and there are enough, else Cpk."""
    requirement = plan.spec.requirement(name) or CAPABLE
    base = MonitoredIndex(response=name, requirement=requirement)
    if answer.refusal:
        return base.model_copy(update={"refusal": answer.refusal})
    sides = [each for each in (answer.ppm_below, answer.ppm_above) if each is not None]
    worse = max(sides, key=lambda each: each.value, default=None)
    asked = plan.spec.responses[name].index or "share"
    if asked == "share" and worse is not None and worse.value * 1e-6 * worse.effective >= FEWEST_REJECTS:
        by, (index, low, high) = "share", _of_share(worse)
    elif answer.cpk is not None:
        by, index, (low, high) = "cpk", answer.cpk.value, answer.cpk.interval
    else:
        return base.model_copy(update={"refusal": "; ".join(answer.notes) or "there is no index"})
    interval = (low, high) if math.isfinite(low) and math.isfinite(high) else None
    below = interval is not None and high < requirement
    found = {"by": by, "index": index, "interval": interval, "below": below, "emulated": answer.emulated}
    return base.model_copy(update=found)


def _of_share(share: Estimate) -> tuple[float, float, float]:
    """Return the index of a share beyond a limit [ppm], and its interval; the larger share is the smaller index."""
    low, high = share.interval
    shares = (min(max(ppm * 1e-6, 1e-300), 1 - 1e-16) for ppm in (share.value, high, low))
    index, least, most = (-float(ndtri(each)) / 3 for each in shares)
    return index, least, most
