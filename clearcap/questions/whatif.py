"""Predict the responses under other distributions of the variables, without new runs.

Settings such as ``J1.std=0.01`` give new distributions, these a ratio of densities at each sample, and the weighted
samples the new results. If the kind of a distribution or its set of parameters changes, missing bounds, mean and
standard deviation are taken from the old distribution, and the user is told which.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite, prod, sqrt
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from campaign.errors import CampaignError, SpecError
from campaign.inputs.distributions import DISTRIBUTIONS, Constant, Distribution
from campaign.inputs.distributions.bounded import Triangular, Uniform
from campaign.inputs.distributions.normal import TruncatedNormal
from campaign.inputs.distributions.skewed import Exponential
from campaign.inputs.sampling import SAMPLERS, draw, sampler_named
from campaign.inputs.sampling.inverse_transform import matrix
from campaign.inputs.sampling.sampler import varied
from campaign.plan import Plan, dump_spec
from campaign.samples import SampleColumns, independent_samples, limits_of, lots_of
from campaign.spec.campaign_file import CampaignSpec
from campaign.spec.faults import structure_faults
from campaign.store import Store
from engine.arrays import Array
from engine.mechanism.faults import did_you_mean
from engine.platform.toml_file import UnfitToml, parse_toml
from reporting import ReportError, capability
from reporting.arrays import pieces
from reporting.capability.shares import PPM, least_ppm
from reporting.emulation.emulated_what_if import NEW_SAMPLES, emulated_what_if
from reporting.format_numbers import ppm
from reporting.shape.histogram import histogram
from reporting.tolerance.reweighting import Change, EstimatedDistribution, Weights, weights
from reporting.tolerance.whatif import WhatIf, what_if_all


@dataclass(frozen=True)
class Refused:
    """Responses that share the reason why there is no answer."""

    reason: str  # why the samples give no answer
    responses: tuple[str, ...]
    runs: int  # new runs that give Cpk, or sigma without limits, of each of these responses to within 5 %


def what_if(
    store: Store,
    plan: Plan,
    settings: Sequence[str],
    estimated: Mapping[str, EstimatedDistribution] | None = None,
    responses: Sequence[str] | None = None,
) -> dict[str, WhatIf]:
    """Return `what_if_from` for the samples in the store."""
    check_drawn(plan.spec)
    changed_variables(plan.spec, settings)  # report faults of settings before reading any row
    columns = independent_samples(store, plan)
    return what_if_from(plan, columns, settings, estimated=estimated, responses=responses)


def what_if_from(
    plan: Plan,
    columns: SampleColumns,
    settings: Sequence[str],
    *,
    emulates: bool = True,
    estimated: Mapping[str, EstimatedDistribution] | None = None,
    responses: Sequence[str] | None = None,
) -> dict[str, WhatIf]:
    """Return all responses, or some, under changed distributions; for the settings see `changed_variables`.

    The intervals include how well the distributions of `estimated` variables are known; others are exact.

    Where the weights of the samples carry no answer, an emulator of the rows gives one if it predicts well, unless it
    would take too long.
    """
    change, lots = change_of(plan, columns, settings), lots_of(plan, columns.number)
    change = replace(change, doubt=_doubt(estimated, columns.values))
    values = {name: columns.values[name] for name in responses or plan.mechanism.responses}
    try:
        answers = what_if_all(values, change, limits_of(plan), lots=lots)
    except ReportError as error:
        raise CampaignError(f"what if of {plan.campaign_id}: {error}") from error
    refused = [name for name, answer in answers.items() if answer.refusal]
    if not refused or not emulates or lots is not None:  # lots share a shift: few, however many samples are emulated
        return answers
    names = varied(plan.spec)
    variables = {**plan.spec.variables, **changed_variables(plan.spec, settings).variables}
    spec = plan.spec.model_copy(update={"variables": variables, "sampler": "random", "samples": NEW_SAMPLES})
    new, old = draw(spec, 0, NEW_SAMPLES), {name: columns.values[name] for name in names}
    limits = limits_of(plan)
    return answers | {
        name: emulated_what_if(
            values[name], old, {v: new[v] for v in names}, limits[name], answers[name], _doubt(estimated, new)
        )
        for name in refused
    }


def _doubt(estimated: Mapping[str, EstimatedDistribution] | None, values: Mapping[str, Array]) -> Array | None:
    """Return what estimated distributions may be off by, at samples (n,): shape (n, 2 variables)."""
    return np.hstack([each.at(values[name]) for name, each in estimated.items()]) if estimated else None


def change_of(plan: Plan, columns: SampleColumns, settings: Sequence[str]) -> Change:
    """Return the effect of settings on the samples; raises the same errors as `what_if_from`."""
    check_drawn(plan.spec)
    return change_distributions(plan.spec, changed_variables(plan.spec, settings).variables, columns.values)


def refusals(answers: Mapping[str, WhatIf]) -> list[Refused]:
    """Return the responses without an answer, grouped by reason."""
    by_reason: dict[str, list[str]] = {}
    for name, answer in answers.items():
        if answer.refusal:
            by_reason.setdefault(answer.refusal, []).append(name)
    return [Refused(why, tuple(names), max(answers[name].runs for name in names)) for why, names in by_reason.items()]


def what_if_document(
    plan: Plan, store_url: str, settings: Sequence[str], answers: Mapping[str, WhatIf]
) -> dict[str, Any]:
    """Return the answers as data, as ``clearcap whatif --json`` and the web service write them."""
    return {
        "campaign": plan.campaign_id,
        "store": store_url,
        "set": list(settings),
        "assumed": changed_variables(plan.spec, settings).assumptions,
        "responses": {name: asdict(answer) for name, answer in answers.items()},
        "refused": [asdict(each) for each in refusals(answers)],
    }


def share_in_words(answer: Mapping[str, Any]) -> tuple[str, str]:
    """Return the share out of limits [ppm] of an answer of `what_if_document`, and what belongs beside it.

    Rejects that weigh less than one effective sample only bound the share: that of a normal distribution comes first.
    """
    counted, expected = answer["ppm"], answer["ppm_expected"]
    if answer["refusal"] or counted is None:
        return "", ""
    low, high = counted["interval"]
    if counted["value"] * answer["effective"] >= PPM:
        return ppm(counted["value"]), f"({ppm(low)} to {ppm(high)})" if high > low else ""
    if expected is None:
        return f"at most {ppm(high)}", ""
    return ppm(expected, least_ppm(int(answer["effective"]))), f"if normal; counted: at most {ppm(high)}"


class Bins(BaseModel):
    """The values of a response in bins, as sampled and under changed distributions."""

    response: str
    unit: str
    lsl: float | None
    usl: float | None
    mean: float | None  # as sampled, as are std and cpk
    std: float | None
    cpk: float | None
    edges: list[float]  # (k + 1)
    before: list[int]  # (k) counts of samples
    # (k) weighted counts with the same sum; None without changes, or for the reason in `refusal`
    after: list[float] | None
    refusal: str


def histograms(plan: Plan, columns: SampleColumns, settings: Sequence[str], responses: Iterable[str]) -> list[Bins]:
    """Return the bins of some responses; raises the same errors as `what_if_from`."""
    found = None
    try:
        found = weights(change_of(plan, columns, settings)) if settings else None
    except ReportError as error:
        raise CampaignError(f"what if of {plan.campaign_id}: {error}") from error
    return [_bins(plan, columns, name, found) for name in responses]


def _bins(plan: Plan, columns: SampleColumns, response: str, found: Weights | None) -> Bins:
    if response not in plan.mechanism.responses:
        allowed = ", ".join(plan.mechanism.responses)
        raise SpecError(f"response {response}: campaign {plan.campaign_id} has no such response; allowed: {allowed}")
    values, (lsl, usl) = columns.values[response], limits_of(plan)[response]
    finite = np.isfinite(values)
    bins, now = histogram(values[finite], lsl, usl), capability(values, lsl, usl, ordered=False)
    after = None
    if bins and found and not found.refusal:
        weight = found.weight[finite]
        weighted, _ = np.histogram(values[finite], np.array(bins.edges), weights=weight * (weight.size / weight.sum()))
        after = weighted.tolist()
    known = {"lsl": lsl, "usl": usl, "mean": now.mean, "std": now.std, "cpk": now.cpk}
    return Bins(
        response=response,
        unit=plan.mechanism.response_units()[response],
        **known,
        edges=list(bins.edges) if bins else [],
        before=list(bins.counts) if bins else [],
        after=after,
        refusal=found.refusal if found and bins else "",
    )


# -- settings become distributions ----------------------------------------------------------------------------------

# Alternative sets of parameters; a distribution is given by one of them.
_DRAWN = (("nominal", "tolerance", "cpk"), ("dimension", "cpk"), ("fit", "cpk"), ("nominal", "inertia"))
_OF_DRAWN = {"shift", "sigma_shift", "inflation"}  # belong to these, not to mean and std
_PARAMETERS = (("mean", "std"), *_DRAWN, ("alpha", "beta"), ("shape", "scale"), ("log_mean", "log_std"))
# Half the width, in standard deviations, of distributions that end at their own bounds.
_HALF_WIDTH: dict[type[Distribution], float] = {Uniform: sqrt(3.0), Triangular: sqrt(6.0)}


@dataclass(frozen=True)
class ChangedVariables:
    """The variables whose distribution settings change."""

    variables: dict[str, Distribution]  # new distributions
    assumptions: tuple[str, ...]  # for each variable, which values were taken from the old one or no longer apply


def changed_variables(spec: CampaignSpec, settings: Sequence[str]) -> ChangedVariables:
    """Return the variables whose distribution settings change.

    A setting is ``VARIABLE.KEY=VALUE``: a key of the variable's table and a TOML value; an empty one removes the key.
    Raises SpecError if a setting does not name a variable and one of its keys, or if a distribution is impossible.
    """
    tables, written = dump_spec(spec), dict[str, set[str]]()
    for setting in settings:
        name, key = _apply(tables["variables"], setting)
        written.setdefault(name, set()).add(key)
    assumed = {}
    for name, keys in written.items():
        table, words = _completed(tables["variables"][name], spec.variables[name], keys)
        tables["variables"][name], assumed[name] = table, words
    try:
        new = CampaignSpec.model_validate(tables)
    except ValidationError as error:
        faults = "\n  ".join(["--set:", *map(str, structure_faults(error, CampaignSpec))])
        raise SpecError(faults.replace("missing; add it", "missing; give it in the same command")) from error
    changed = {name: v for name, v in new.variables.items() if v != spec.variables[name]}
    for name in changed:
        if getattr(spec.variables[name], "joint", None) or getattr(new.variables[name], "joint", None):
            raise SpecError(
                f"--set {name}: its values are taken from the rows of a table, together with those of others, which"
                " weights of the samples cannot change; run a campaign with other values"
            )
    assumptions = []
    for name, distribution in changed.items():
        if taken := assumed.get(name):
            old, now = (each.moments()[1] for each in (spec.variables[name], distribution))
            said = f"{name} is now {distribution.text()} ({taken.strip('; ')})"
            assumptions.append(f"{said}; its sigma was {old:.4g} and is {now:.4g}")
    return ChangedVariables(changed, tuple(assumptions))


def _apply(variables: dict[str, dict[str, Any]], setting: str) -> tuple[str, str]:
    """Apply one setting to the tables of the variables; return the variable and its key."""
    name = next((n for n in sorted(variables, key=len, reverse=True) if setting.startswith(f"{n}.")), None)
    key, sign, text = setting[len(name or "") + 1 :].partition("=")
    if name is None or not sign or not key:
        first = setting.partition(".")[0].partition("=")[0]
        raise SpecError(
            f"--set {setting}: allowed is VARIABLE.KEY=VALUE with VARIABLE one of {', '.join(variables)}"
            f"{did_you_mean(first, list(variables))}; write for example --set {next(iter(variables))}.std=0.01"
        )
    if key == "target":
        raise SpecError(
            f"--set {setting}: target is the key of the mechanism that {name} sets, and no part of its distribution;"
            " another target needs a new campaign"
        )
    *tables, last = key.split(".")
    table = variables[name]
    for part in tables:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            allowed = "VARIABLE.KEY=VALUE with a key of the variable"
            raise SpecError(f"--set {setting}: {part} is not a table; allowed: {allowed}")
    if not text:
        table.pop(last, None)
        return name, key.partition(".")[0]
    try:
        table[last] = parse_toml(f"x = {text}".encode("utf-8", "surrogateescape"))["x"]
    except UnfitToml:
        table[last] = text  # a name whose quotes the shell removed
    return name, key.partition(".")[0]


def _completed(table: dict[str, Any], old: Distribution, written: set[str]) -> tuple[dict[str, Any], str]:
    """Return a variable's table with the missing values added, and a description of values taken and dropped."""
    model = DISTRIBUTIONS.get(str(table.get("distribution")))
    sets = [] if model is None else [keys for keys in _parameters(model) if written & set(keys)]
    chosen = max(sets, key=lambda keys: len(table.keys() & set(keys)), default=None)  # cpk belongs to several
    if model is None or (type(old) is model and chosen is None):
        return table, ""
    another = type(old) is not model
    gone = {key for key in table if another and key not in model.model_fields}
    if chosen or another:  # except for mean and std, a key has another meaning in another kind of distribution
        same = set() if chosen or model is Exponential else {"mean", "std", *(key for keys in _DRAWN for key in keys)}
        gone |= {key for keys in _PARAMETERS for key in keys} & table.keys() - same - set(chosen or ())
    if chosen == ("mean", "std"):
        gone |= _OF_DRAWN & table.keys()
    if model is TruncatedNormal and written & {"dimension", "fit"}:
        gone |= {"lower", "upper"}  # those of the new drawing
    kept = {key: value for key, value in table.items() if key in written or key not in gone}
    taken = {key: value for key, value in _missing(model, kept, old, chosen).items() if key not in written}
    stays = [key for key in kept if another and key not in written and isinstance(kept[key], float | int)]
    words = [f"{key} = {taken[key]:g} from the old distribution" for key in taken]
    words += [f"{key} = {kept[key]:g} as before" for key in stays]
    dropped = sorted(gone - written)
    said = [", ".join(words), *([f"no longer used: {', '.join(dropped)}"] if dropped else [])]
    return {**kept, **taken}, "; ".join(said)


def _parameters(model: type[Distribution]) -> list[tuple[str, ...]]:
    if model is Exponential:
        return [("scale",), ("mean",), ("std",)]
    return [keys for keys in _PARAMETERS if set(keys) <= model.model_fields.keys()]


def _missing(
    model: type[Distribution], table: Mapping[str, Any], old: Distribution, chosen: tuple[str, ...] | None
) -> dict[str, float]:
    """Return the missing keys that the old distribution can provide: bounds, mean and standard deviation."""
    mean, std = old.moments()
    if model is Constant:
        return {} if "value" in table else {"value": mean}
    if model is Exponential:
        return {} if chosen else {"origin": mean - std, "scale": std}
    found = _ends(model, table, old)
    if model is Triangular and "mode" not in table and {"lower", "upper"} <= {**table, **found}.keys():
        found["mode"] = float(np.clip(mean, *({**table, **found}[end] for end in ("lower", "upper"))))
    sets = _parameters(model)
    if ("mean", "std") in sets and (chosen == ("mean", "std") or not any(set(keys) <= table.keys() for keys in sets)):
        taken = {"mean": mean, "std": std} if chosen in (None, ("mean", "std")) else {}
        found |= {key: x for key, x in taken.items() if key not in table}
    return found


def _ends(model: type[Distribution], table: Mapping[str, Any], old: Distribution) -> dict[str, float]:
    """Return the required but missing ends of a distribution: the old ends, or ends that keep the old mean and std."""
    fields = {} if {"dimension", "fit"} & table.keys() else model.model_fields
    lacking = [end for end in ("lower", "upper") if end in fields and end not in table and fields[end].is_required()]
    ends = dict(zip(("lower", "upper"), old.support(), strict=True))
    if not all(map(isfinite, ends.values())):
        if model not in _HALF_WIDTH:
            return {}
        mean, std = old.moments()
        ends = {"lower": mean - _HALF_WIDTH[model] * std, "upper": mean + _HALF_WIDTH[model] * std}
    return {end: ends[end] for end in lacking}


# -- distributions become ratios of densities -----------------------------------------------------------------------

_LOGITS = np.linspace(-30.0, 30.0, 4001)  # probabilities from 1e-13 to 1 - 1e-13
_NEAREST = 1e-16  # distance from 0 and 1 of a probability that becomes a normal score


def check_drawn(spec: CampaignSpec) -> None:
    """Raise SpecError if the samples are not drawn from distributions."""
    if not sampler_named(spec.sampler).weighted:
        *names, last = (name for name, sampler in SAMPLERS.items() if sampler.weighted)
        raise SpecError(
            f"sampler {spec.sampler}: its samples do not follow distributions, so they cannot be weighted for others;"
            f" run a campaign with sampler {', '.join(names)} or {last}"
        )


def change_distributions(spec: CampaignSpec, new: Mapping[str, Distribution], columns: Mapping[str, Array]) -> Change:
    """Return the effect of new distributions of some variables on samples (n,); rank correlations stay the same.

    The effect is the logarithm of the ratio of densities at each sample, and the new probability outside the old
    distributions. Raises SpecError if the samples are not drawn from distributions.
    """
    check_drawn(spec)
    n = next(iter(columns.values())).size
    ratio, inside = np.zeros(n), 1.0
    for name, distribution in new.items():
        old = spec.variables[name]
        for rows in pieces(n):
            ratio[rows] += distribution.logpdf(columns[name][rows]) - old.logpdf(columns[name][rows])
        inside *= 1.0 - _outside(distribution, *old.support())
    if any(name in pair for name in new for pair in spec.correlations or ()):
        ratio += _copula({**spec.variables, **new}, spec, columns) - _copula(spec.variables, spec, columns)
    worth = samples_worth([(spec.variables[name], distribution) for name, distribution in new.items()])
    ratio[np.isnan(ratio)] = -np.inf
    return Change(ratio, max(1.0 - inside, 0.0), worth=worth)


def _outside(new: Distribution, low: float, high: float) -> float:
    # just below the bound, because a discrete distribution may have a value on it
    below = float(new.cdf(np.array([np.nextafter(low, -np.inf)]))[0]) if isfinite(low) else 0.0
    above = 1.0 - float(new.cdf(np.array([high]))[0]) if isfinite(high) else 0.0
    return min(max(below + above, 0.0), 1.0)


def _copula(variables: Mapping[str, Distribution], spec: CampaignSpec, columns: Mapping[str, Array]) -> Array:
    """Return the logarithm of the density of the Gaussian copula at samples, without its constant."""
    from scipy.special import ndtri

    correlations = spec.correlations or ()
    names = tuple(name for name in variables if any(name in pair for pair in correlations))
    scores = np.array([ndtri(np.clip(variables[n].cdf(columns[n]), _NEAREST, 1 - _NEAREST)) for n in names])
    excess = np.linalg.inv(matrix(names, correlations)) - np.eye(len(names))
    return np.asarray(-0.5 * np.einsum("in,ij,jn->n", scores, excess, scores), dtype=np.float64)


def samples_worth(changes: Sequence[tuple[Distribution, Distribution]]) -> float:
    """Return how many new runs (at most 1) a sample is worth for estimating sigma, for the variable where it is least.

    The variance of a sample's contribution to the weighted estimate of a variance is ``E_old[w^2 (z^2 - 1)^2]``, with
    the weight ``w`` and the value ``z`` in sigmas of the new distribution; that of a new run is ``E_new[(z^2 - 1)^2]``.
    Their ratio is infinite if a normal distribution gets sqrt(2) times its sigma or more.
    """
    # a grid even in the logit is fine in both tails, where the weights may be large; u (1 - u) are its widths
    u = 1.0 / (1.0 + np.exp(-_LOGITS))
    share = u * (1.0 - u)
    share /= share.sum()
    squares, costs = [], []
    for old, new in changes:
        x = new.ppf(u)
        mean, std = new.moments()
        with np.errstate(over="ignore", invalid="ignore"):
            known = np.isfinite(old.logpdf(x))  # the probability outside is judged separately
            weight = np.where(known, np.exp(np.minimum(new.logpdf(x) - old.logpdf(x), 300.0)), 0.0)
            part = ((x - mean) / std) ** 2 - 1.0 if std > 0 else np.zeros_like(x)
            of_new = float(np.sum(share * part**2))
            squares.append(max(float(np.nansum(share * weight)), 1.0))
            costs.append(float(np.nansum(share * weight * part**2)) / of_new if of_new > 0 else 1.0)
    shares = [cost * prod(squares) / square for cost, square in zip(costs, squares, strict=True)]
    return min(1.0, 1.0 / max([1.0, *shares]))
