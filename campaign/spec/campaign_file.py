"""The campaign file: models of its keys and values, and its text from tables or proposed from a CAD file."""

from collections.abc import Iterable, Mapping
from decimal import Decimal
from math import inf, pi
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import tomli_w
from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticKnownError

from campaign.inputs.distributions import Variable
from campaign.inputs.sampling import SAMPLERS, check_sampling
from campaign.inputs.sampling.importance import Proposal
from engine.mechanism.base import Number, PositiveNumber, TableModel
from engine.mechanism.faults import did_you_mean

if TYPE_CHECKING:
    from engine.cad_import.drawn_tolerances import Diameter, Zone


# statuses that other settings could avoid; an ``invalid`` run is a result, and settings do not cause a crash
RETRIED = ("not_at_rest", "not_converged", "jammed", "diverged", "timeout")
FIRST_RUNS = 100  # if all fail, so will the others: with 5 % success, the first 100 all fail in 0.6 % of cases
GROWTH = 4  # from a checkpoint of n samples the next one is n / GROWTH samples away
LARGEST_LIST = 1_000_000  # rows of a user's table
MOST_VARIABLES = 1000
DECIDING_RUNS = 4000  # of an aimed campaign

ShortName = Annotated[str, Field(min_length=1, max_length=100)]
Correlation = Annotated[
    tuple[ShortName, ShortName, Annotated[float, Field(gt=-1.0, lt=1.0, allow_inf_nan=False)]], Field(strict=False)
]
Levels = (
    Annotated[int, Field(ge=2, le=LARGEST_LIST)]
    | Annotated[tuple[Number, ...], Field(strict=False, min_length=1, max_length=100_000)]
)
CPK = 1.33  # assumed for a dimension if only its limits are known, as in the docs
SAMPLES = 1000
_HEAD = """\
# Proposed by clearcap mechanism import from the limits and zones in the CAD file: of each diameter its class, or the
# middle of its limits and half of what lies between them, with an assumed Cpk; in a zone all places are alike.
#? variables: with which Cpk, or which distribution, is each of these diameters made?
#? responses: what are the limits of what is read off? Give lsl and usl in [responses.NAME]
"""


class SimulationSettings(TableModel, strict=True):
    """Settings of every run that replace the mechanism's own."""

    step: PositiveNumber | None = Field(
        default=None, description="Time step, in the mechanism's unit of time, above 0; the mechanism's own if absent."
    )
    horizon: PositiveNumber | None = Field(
        default=None,
        description="Longest simulated time, in the mechanism's unit of time, above 0; the mechanism's own if absent.",
    )
    tolerance: Annotated[float | None, Field(gt=0.0, le=1e-3, allow_inf_nan=False)] = Field(
        default=None,
        description="Relative residual of the friction problems, above 0, at most 1e-3; the mechanism's own if absent.",
    )

    def values(self) -> dict[str, float]:
        """Return the given settings that are keys of the mechanism."""
        return {} if self.tolerance is None else {"simulation.tolerance": self.tolerance}

    def text(self) -> str:
        """Return the settings in words."""
        given = self.model_dump(exclude_none=True)
        return ", ".join(f"{key} {value:g}" for key, value in given.items()) or "settings of the mechanism"


class Failures(TableModel, strict=True):
    """What happens if runs fail."""

    retry: Annotated[tuple[SimulationSettings, ...], Field(max_length=10, strict=False)] = Field(
        default=(),
        description="Settings of further attempts at a run that did not come to rest or converge, jammed, diverged or"
        " took too long, in the order of the attempts; at most 10.",
    )
    max_failed: Annotated[int, Field(ge=0)] | Annotated[float, Field(ge=0.0, lt=1.0)] | None = Field(
        default=None,
        description="The campaign stops as soon as more rows than this have failed: a number of rows or, below 1, a"
        f" share of all samples. If absent, it stops only when its first {FIRST_RUNS} runs have all failed.",
    )
    min_ok: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.99,
        description="Least share of ok runs of all that are done, from 0 to 1; samples that max_not_assemblable judges"
        " do not count. With fewer, failed runs may decide every"
        " verdict: the report gives none, and the command ends with exit status 1.",
    )

    max_not_assemblable: Annotated[float | None, Field(ge=0.0, lt=1.0, allow_inf_nan=False)] = Field(
        default=None,
        description="Largest share of samples whose parts cannot be assembled, from 0 to below 1. With it such samples"
        " are a result and no failure: variables may reach values with which the parts do not fit, the report judges"
        " the share, and all else is about the samples that fit. If absent, such values are refused.",
    )

    def most_failed(self, samples: int) -> float:
        """Return the number of rows that may fail in a campaign of ``samples`` samples; infinite without a limit."""
        if self.max_failed is None:
            return float("inf")
        return self.max_failed if isinstance(self.max_failed, int) else self.max_failed * samples

    def is_hopeless(self, ok: int, done: int) -> bool:
        """Return whether enough runs are done, all of them failed, to stop the campaign."""
        return self.max_failed is None and ok == 0 and done >= FIRST_RUNS


class RepeatSettings(TableModel, strict=True):
    """Samples that are simulated a second time, with half the step, to see how far results depend on it."""

    share: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] = Field(
        description="Share of the samples to repeat, from 0 (none) to 1 (all). A repeat takes about twice the time of"
        " its run, and enters no statistic but the report's repeatability."
    )


class Execution(TableModel, strict=True):
    """What one run may cost."""

    time_limit: PositiveNumber | None = Field(
        default=None,
        description="Longest wall-clock time of a run [s], above 0; the mechanism's simulation.wall_limit if absent.",
    )
    memory_limit: Annotated[float, Field(ge=0.5, allow_inf_nan=False)] = Field(
        default=4.0, description="Largest memory of a process that simulates [GiB], at least 0.5."
    )

    def values(self) -> dict[str, float]:
        """Return the given limits that are keys of the mechanism."""
        return {} if self.time_limit is None else {"simulation.wall_limit": self.time_limit}


class Decide(TableModel, strict=True):
    """What may be spent on verdicts that the samples leave open."""

    runs: Annotated[int, Field(ge=0, le=100_000_000)] = Field(
        default=DECIDING_RUNS,
        description="Most further runs, drawn where rejects are expected: 1,000, and 250 more for each response whose"
        " verdict is not certain, and again for what is open then; 0 for none.",
    )


class Stop(TableModel, strict=True):
    """The campaign stops as soon as a statistic is precise enough, and computes no further samples.

    The rule is evaluated at checkpoints, which are numbers of samples. At a checkpoint n it takes the first n samples
    and stops the campaign if the confidence interval of the statistic is narrow enough. So the end of a campaign
    depends neither on the number of workers nor on the order in which rows arrive. With production batches, at least
    five must be complete, as intervals rest on the differences between them.
    """

    response: Annotated[str, Field(min_length=1)] = Field(description="Name of the response that the rule is about.")
    statistic: Literal["mean", "std", "cp", "cpk", "ppm"] = Field(
        description="Statistic of the response: mean, std, cp, cpk, or ppm (the observed share out of limits)."
    )
    half_width: PositiveNumber = Field(
        description="Half the width of the statistic's confidence interval at which the campaign stops, in its unit,"
        " above 0."
    )
    confidence: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=0.95, description="Confidence of the two-sided interval, between 0 and 1."
    )
    min_samples: Annotated[int, Field(ge=2, le=100_000_000)] = Field(
        default=100, description="First checkpoint, at least 2 samples; each later one has a quarter more samples."
    )
    max_samples: Annotated[int | None, Field(ge=2, le=100_000_000)] = Field(
        default=None,
        description="Number of samples at which the campaign ends at the latest, at least min_samples; the campaign's"
        " samples if absent.",
    )

    @model_validator(mode="after")
    def _least_and_most(self) -> Self:
        if self.max_samples is not None and self.max_samples < self.min_samples:
            raise ValueError(
                f"max_samples = {self.max_samples} is less than min_samples = {self.min_samples}; exchange them"
            )
        return self

    def checkpoints(self, samples: int) -> tuple[int, ...]:
        """Return the numbers of samples at which the rule is evaluated; the last is ``samples``."""
        points, n = [], self.min_samples
        while n < samples:
            points.append(n)
            n += max(n // GROWTH, 1)
        return (*points, samples)


def _known_sampler(value: Any) -> Any:
    """Return the name of a sampler; refuse any other value with pydantic's error for a choice."""
    if value not in list(SAMPLERS):
        *first, last = (f"'{name}'" for name in SAMPLERS)
        raise PydanticKnownError("literal_error", {"expected": f"{', '.join(first)} or {last}"})
    return value


def _describe_samplers(schema: dict[str, Any]) -> None:
    summaries = "; ".join(f"{name}: {sampler.summary}" for name, sampler in SAMPLERS.items())
    schema.update(enum=list(SAMPLERS), description=f"How samples are drawn. {summaries}.")


SamplerName = Annotated[str, BeforeValidator(_known_sampler)]
Column = Annotated[tuple[Number, ...], Field(strict=False, min_length=1, max_length=LARGEST_LIST)]


class Historical(TableModel, strict=True):
    """Mean and sigma that a process is known to have, in the unit of the response."""

    mean: Number = Field(description="Historical mean, in the response's unit.")
    sigma: PositiveNumber = Field(description="Historical standard deviation, in the response's unit, above 0.")


class Response(TableModel, strict=True):
    """Limits of one functional condition, in its unit; all of them are optional."""

    lsl: Number | None = Field(
        default=None, description="Lower specification limit, in the response's unit; no limit if absent."
    )
    usl: Number | None = Field(
        default=None, description="Upper specification limit, in the response's unit, above lsl; no limit if absent."
    )
    nominal: Number | None = Field(
        default=None,
        description="With tolerance, instead of lsl and usl: the middle between them, in the response's unit.",
    )
    tolerance: PositiveNumber | None = Field(
        default=None, description="Distance of both limits from the nominal, in the response's unit, above 0."
    )
    target: Number | None = Field(
        default=None,
        description="Value that production aims at, between the limits, in the response's unit; the nominal if absent.",
    )
    upper: Number | None = Field(
        default=None,
        description="With nominal and lower, unequal tolerances: deviation of usl from the nominal, signed.",
    )
    lower: Number | None = Field(
        default=None, description="Deviation of lsl from the nominal, signed and below upper: -0.1 for 20 +0.2/-0.1."
    )
    boundary: Literal["lower", "upper"] | None = Field(
        default=None,
        description="The limit that no value can pass, as 0 for a gap, ovality or run-out: it has no index and no share"
        " beyond it.",
    )
    historical: Historical | None = Field(
        default=None,
        description="Mean and sigma that the process is known to have: the report adds the indices with them, and says"
        " whether the values agree.",
    )
    requirement: PositiveNumber | ShortName | None = Field(
        default=None,
        description="Index from which on the response is capable, or a class of the table requirements; 1.33 if"
        " absent.",
    )
    index: Literal["share", "cpk", "percentile"] | None = Field(
        default=None,
        description="The index that decides the verdict: of the share beyond the worse limit (Cpk where values are"
        " normal; if absent), Cpk by mean and sigma whatever the shape, or the percentile index of ISO 22514-2.",
    )
    source: str = Field(
        default="", description='Where the limits come from; begins with "assumption" if nobody has published them.'
    )

    @model_validator(mode="after")
    def _limits_make_sense(self) -> Self:
        unequal = (self.lower, self.upper) != (None, None)
        given = self.tolerance is not None or unequal
        if given and unequal == (self.tolerance is not None):
            raise ValueError("tolerance is the same on both sides, lower and upper are not; give one or the other")
        if unequal and (self.lower is None or self.upper is None or not self.lower < self.upper):
            raise ValueError("lower and upper are only valid together, signed, with lower below upper: -0.1 and 0.2")
        if (self.nominal is None) == given:
            raise ValueError(
                "nominal and tolerance are only valid together, or nominal with lower and upper; or give lsl and usl"
            )
        if self.nominal is not None and (self.lsl is not None or self.usl is not None):
            raise ValueError("nominal and tolerance already define lsl and usl; give one pair or the other")
        lsl, usl, target = self.limits()
        if lsl is not None and usl is not None and not lsl < usl:
            raise ValueError(f"lsl = {lsl:g} is not below usl = {usl:g}; exchange or widen the limits")
        if target is not None and not (-inf if lsl is None else lsl) <= target <= (inf if usl is None else usl):
            raise ValueError(f"target = {target:g} lies outside the limits {lsl} to {usl}; production cannot aim there")
        if self.boundary and (lsl if self.boundary == "lower" else usl) is None:
            raise ValueError(f'boundary = "{self.boundary}": there is no {self.boundary} limit; give it, as lsl = 0')
        return self

    def limits(self) -> tuple[float | None, float | None, float | None]:
        """Return lower limit, upper limit and target; None where there is none."""
        if self.nominal is None:
            return self.lsl, self.usl, self.target
        # in decimals, as on a drawing: 2.11 - 0.25 is 1.86 and not 1.8599999999999999
        nominal, equal = Decimal(repr(self.nominal)), self.tolerance or 0.0
        low = nominal + Decimal(repr(-equal if self.lower is None else self.lower))
        high = nominal + Decimal(repr(equal if self.upper is None else self.upper))
        target = self.nominal if self.target is None and low <= nominal <= high else self.target
        return float(low), float(high), target


class SampleTable(TableModel, strict=True):
    """The samples of a user's table."""

    file: Annotated[str | None, Field(min_length=1)] = Field(
        default=None,
        description="CSV or Parquet file with a column for each variable; its path is relative to the campaign file.",
    )
    columns: dict[ShortName, Column] | None = Field(
        default=None,
        description="Instead of a file: the values of each variable by its name, in the unit of its target.",
    )
    source: str = Field(default="", description="Where the values come from, in words.")

    @model_validator(mode="after")
    def _one_origin(self) -> Self:
        if (self.file is None) == (self.columns is None):
            raise ValueError("give file or columns, not both")
        lengths = {name: len(column) for name, column in (self.columns or {}).items()}
        if len(set(lengths.values())) > 1:
            text = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(f"columns have different lengths ({text}); every row needs a value of each variable")
        return self


class CampaignSpec(TableModel, strict=True):
    """A campaign: which mechanism, which inputs vary and how, the limits of its responses, how many samples."""

    format: Literal[1] = Field(description="Version of this file format: 1.")
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,59}$")] = Field(
        description="Beginning of the campaign's id, which names its folder: up to 60 letters, digits, - and _."
    )
    title: str = Field(default="", description="Title of the report; the name if absent.")
    mechanism: ShortName = Field(
        description="Name of a shipped mechanism, or path of a mechanism file relative to the campaign file."
    )
    bench: ShortName | None = Field(
        default=None, description="Test bench of the mechanism to simulate it on; without a bench if absent."
    )
    preset: ShortName | None = Field(
        default=None,
        description="Named set of values of the mechanism that it has before the variables set theirs; its own values"
        " if absent.",
    )
    samples: Annotated[int, Field(ge=1, le=100_000_000)] = Field(
        description="Number of samples, from 1 to 100 million."
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(
        default=0, description="Seed of all random numbers, at least 0, below 2^63."
    )
    sampler: SamplerName = Field(default="random", json_schema_extra=_describe_samplers)
    simulation: SimulationSettings = Field(
        default=SimulationSettings(),
        description="Step, horizon and tolerance of every run; the mechanism's own if absent.",
    )
    failures: Failures = Field(
        default=Failures(), description="Further attempts at failed runs, and how many runs may fail."
    )
    execution: Execution = Field(default=Execution(), description="Limits of the time and memory of one run.")
    repeats: RepeatSettings | None = Field(
        default=None,
        description="How many samples are simulated a second time, with half the step; if absent a few per cent: 3 % of"
        " them, up to 5 % to get 20, at most 300, and none with sampler importance.",
    )
    stop: Stop | None = Field(
        default=None,
        description="Rule that stops the campaign early, once a statistic is precise enough; all samples if absent.",
    )
    decide: Decide | None = Field(
        default=None,
        description=f"What may be spent on verdicts that are not certain; at most {DECIDING_RUNS} runs if absent.",
    )
    author: Annotated[str | None, Field(min_length=1)] = Field(
        default=None,
        description="Who answers for the campaign, for the head of the report; who submitted it if absent.",
    )
    header: Annotated[dict[str, str], Field(default_factory=dict)] = Field(
        description="Lines of free text for the head of the report: part, author, revision, ..."
    )
    variables: Annotated[dict[ShortName, Variable], Field(min_length=1, max_length=MOST_VARIABLES)] = Field(
        description="Distribution of each input that varies. Its name is the key of the mechanism that it sets, unless"
        " target names another key."
    )
    correlations: Annotated[tuple[Correlation, ...], Field(strict=False)] | None = Field(
        default=None,
        description="Pairs of variables with Spearman's rank correlation, each [variable, variable, correlation] with a"
        " correlation between -1 and 1.",
    )
    grid: dict[ShortName, Levels] | None = Field(
        default=None,
        description="Only for sampler grid: the number of levels of each variable, at least 2, or the levels.",
    )
    table: SampleTable | None = Field(default=None, description="Only for sampler list: the samples.")
    importance: Proposal | None = Field(
        default=None, description="Only for sampler importance: where rejects are expected, and samples are drawn."
    )
    requirements: dict[ShortName, PositiveNumber] | None = Field(
        default=None,
        description="Required index of each class of characteristics that responses name, such as critical = 2.0.",
    )
    responses: Annotated[dict[ShortName, Response], Field(default_factory=dict)] = Field(
        description="Limits of each response of the mechanism by its name; other responses are reported without limits."
    )

    @model_validator(mode="before")
    @classmethod
    def _samples_of_a_stop(cls, data: Any) -> Any:
        """Limit the number of samples to the stopping rule's ``max_samples``, which is also the default."""
        stop = data.get("stop") if isinstance(data, dict) else None
        largest = stop.get("max_samples") if isinstance(stop, dict) else None
        samples = data.get("samples", largest) if isinstance(largest, int) else None
        if not isinstance(samples, int) or not isinstance(largest, int):
            return data
        return {**data, "samples": min(samples, largest)}

    @model_validator(mode="after")
    def _classes_are_known(self) -> Self:
        for name, response in self.responses.items():
            known, wanted = self.requirements or {}, response.requirement
            if isinstance(wanted, str) and wanted not in known:
                raise ValueError(
                    f'responses.{name}.requirement = "{wanted}": no such class; allowed: a number, or one of'
                    f" requirements: {', '.join(known) or 'none is given'}{did_you_mean(wanted, known)}"
                )
        return self

    @model_validator(mode="after")
    def _samples_can_be_drawn(self) -> Self:
        check_sampling(self)
        return self

    def requirement_class(self, response: str) -> str:
        """Return the class of the table requirements that a response names; empty if it names none."""
        wanted = self.responses.get(response, Response()).requirement
        return wanted if isinstance(wanted, str) else ""

    def requirement(self, response: str) -> float | None:
        """Return the index from which on a response is capable; None if the file does not say."""
        wanted = self.responses.get(response, Response()).requirement
        return (self.requirements or {})[wanted] if isinstance(wanted, str) else wanted

    def targets(self) -> dict[str, str]:
        """Return the key of the mechanism that each variable sets, by variable name."""
        return {name: variable.target or name for name, variable in self.variables.items()}


def campaign_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file."""
    return CampaignSpec.model_json_schema()


# -- its text ----------------------------------------------------------------------------------------------------------


def campaign_text(tables: Mapping[str, Any]) -> str:
    """Return the text of a campaign file.

    Parameters
    ----------
    tables : mapping
        The tables of the file as Python data, valid or not; entries that are None are left out.

    Returns
    -------
    str
        TOML with the same values. Top-level keys are in reading order: format, name, mechanism, ..., variables,
        responses; keys inside a table keep their order.

    Raises
    ------
    TypeError
        If a value in the tables has no equivalent in TOML.
    """
    known = {key: tables[key] for key in CampaignSpec.model_fields if key in tables}
    return tomli_w.dumps(_given({**known, **tables}))


def _given(value: Any) -> Any:
    """Return a value without the entries of its tables that are None."""
    if isinstance(value, Mapping):
        return {key: _given(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_given(inner) for inner in value]
    return value


def proposed_campaign(diameters: "Iterable[Diameter]", zones: "Iterable[Zone]", mechanism: str, name: str) -> str:
    """Return the text of a campaign file that varies diameters and zones of a mechanism file, relative to it."""
    variables: dict[str, dict[str, Any]] = {}
    for diameter in diameters:
        middle, half = (diameter.lower + diameter.upper) / 2, (diameter.upper - diameter.lower) / 2
        limits = {"nominal": round(middle, 9), "tolerance": round(half, 9)}
        variables[diameter.parameter] = {
            "target": f"parameters.{diameter.parameter}",
            "distribution": "normal",
            **({"dimension": diameter.words} if diameter.tolerance_class else limits),
            "cpk": CPK,
        }
    for zone in zones:
        way = f"{zone.keys}.{zone.way}"
        variables[zone.variable] = {"target": zone.target, "distribution": "position", "zone": zone.width}
        turn = {"distribution": "uniform", "lower": 0.0, "upper": round(2 * pi, 9)}
        variables[f"{zone.stem}_{zone.way}"] = {"target": way, **turn}
    tables = {"format": 1, "name": name, "mechanism": mechanism, "samples": SAMPLES}
    return _HEAD + campaign_text(tables | ({"variables": variables} if variables else {}))
