"""The pydantic models of a campaign file: which keys and values are allowed."""

from decimal import Decimal
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticKnownError

from campaign.inputs.distributions import Variable
from campaign.inputs.sampling import SAMPLERS, check_sampling
from campaign.inputs.sampling.proposal import Proposal
from campaign.spec.policy import Execution, Failures, RepeatSettings, SimulationSettings, Stop
from engine.mechanism.base import Number, PositiveNumber, TableModel

LARGEST_LIST = 1_000_000  # rows of a user's table
MOST_VARIABLES = 1000

ShortName = Annotated[str, Field(min_length=1, max_length=100)]
Correlation = Annotated[
    tuple[ShortName, ShortName, Annotated[float, Field(gt=-1.0, lt=1.0, allow_inf_nan=False)]], Field(strict=False)
]
Levels = (
    Annotated[int, Field(ge=2, le=LARGEST_LIST)]
    | Annotated[tuple[Number, ...], Field(strict=False, min_length=1, max_length=100_000)]
)


def _known_sampler(value: Any) -> Any:
    """Return the name of a sampler; refuse any other value with pydantic's error for a choice."""
    if value not in list(SAMPLERS):
        *first, last = (f"'{name}'" for name in SAMPLERS)
        raise PydanticKnownError("literal_error", {"expected": f"{', '.join(first)} or {last}"})
    return value


def _describe_samplers(schema: dict[str, Any]) -> None:
    """Put the samplers into the JSON Schema of the key."""
    summaries = "; ".join(f"{name}: {sampler.summary}" for name, sampler in SAMPLERS.items())
    schema.update(enum=list(SAMPLERS), description=f"How samples are drawn. {summaries}.")


SamplerName = Annotated[str, BeforeValidator(_known_sampler)]
Column = Annotated[tuple[Number, ...], Field(strict=False, min_length=1, max_length=LARGEST_LIST)]


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
        default=None, description="Value that production aims at, in the response's unit; the nominal if absent."
    )
    source: str = Field(
        default="",
        description='Where the limits come from; begins with "assumption" if nobody has published them.',
    )

    @model_validator(mode="after")
    def _limits_make_sense(self) -> Self:
        if (self.nominal is None) != (self.tolerance is None):
            raise ValueError("nominal and tolerance are only valid together; give both, or lsl and usl")
        if self.nominal is not None and (self.lsl is not None or self.usl is not None):
            raise ValueError("nominal and tolerance already define lsl and usl; give one pair or the other")
        if self.lsl is not None and self.usl is not None and not self.lsl < self.usl:
            raise ValueError(f"lsl = {self.lsl:g} is not below usl = {self.usl:g}; exchange or widen the limits")
        return self

    def limits(self) -> tuple[float | None, float | None, float | None]:
        """Return lower limit, upper limit and target; None where there is none."""
        if self.nominal is None or self.tolerance is None:
            return self.lsl, self.usl, self.target
        target = self.nominal if self.target is None else self.target
        # in decimals, as on a drawing: 2.11 - 0.25 is 1.86 and not 1.8599999999999999
        nominal, tolerance = Decimal(repr(self.nominal)), Decimal(repr(self.tolerance))
        return float(nominal - tolerance), float(nominal + tolerance), target


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
        default=Failures(),
        description="Further attempts at failed runs, and how many runs may fail.",
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
    def _samples_can_be_drawn(self) -> Self:
        check_sampling(self)
        return self

    def targets(self) -> dict[str, str]:
        """Return the key of the mechanism that each variable sets, by variable name."""
        return {name: variable.target or name for name, variable in self.variables.items()}


def campaign_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file."""
    return CampaignSpec.model_json_schema()
