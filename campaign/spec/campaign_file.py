"""What a user writes in a campaign file, checked by models that name the key at fault."""

from decimal import Decimal
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticKnownError

from campaign.inputs.distributions import PositiveNumber, Variable
from campaign.inputs.sampling import SAMPLERS, check_sampling
from campaign.spec.policy import Execution, Failures, SimulationSettings, Stop
from engine.mechanism.base import Number, TableModel

LARGEST_LIST = 1_000_000  # rows of a user's table

ShortName = Annotated[str, Field(min_length=1, max_length=100)]
Correlation = Annotated[
    tuple[ShortName, ShortName, Annotated[float, Field(gt=-1.0, lt=1.0, allow_inf_nan=False)]], Field(strict=False)
]
Levels = (
    Annotated[int, Field(ge=2)] | Annotated[tuple[Number, ...], Field(strict=False, min_length=1, max_length=100_000)]
)


def _known_sampler(name: str) -> str:
    """Return the name of a sampler; refuse any other, in pydantic's words for a choice."""
    if name not in SAMPLERS:
        *first, last = (f"'{sampler}'" for sampler in SAMPLERS)
        raise PydanticKnownError("literal_error", {"expected": f"{', '.join(first)} or {last}"})
    return name


SamplerName = Annotated[
    str,
    AfterValidator(_known_sampler),
    Field(json_schema_extra=lambda schema: schema.update(enum=list(SAMPLERS))),
]
Column = Annotated[tuple[Number, ...], Field(strict=False, min_length=1, max_length=LARGEST_LIST)]


class Response(TableModel, strict=True):
    """Limits of one functional condition, in its unit; all optional.

    Attributes
    ----------
    lsl, usl : float or None
        Lower and upper limit.
    nominal, tolerance : float or None
        Instead of the limits: nominal - tolerance and nominal + tolerance, with the nominal as target.
    target : float or None
        What production aims at.
    source : str
        Where the limits come from; begins with "assumption" when nobody has published them.
    """

    lsl: Number | None = None
    usl: Number | None = None
    nominal: Number | None = None
    tolerance: PositiveNumber | None = None
    target: Number | None = None
    source: str = ""

    @model_validator(mode="after")
    def _limits_make_sense(self) -> Self:
        if (self.nominal is None) != (self.tolerance is None):
            raise ValueError("nominal and tolerance belong together; give both, or lsl and usl")
        if self.nominal is not None and (self.lsl is not None or self.usl is not None):
            raise ValueError("nominal and tolerance already say lsl and usl; give one pair or the other")
        if self.lsl is not None and self.usl is not None and not self.lsl < self.usl:
            raise ValueError(f"lsl = {self.lsl:g} is not below usl = {self.usl:g}; exchange or widen the limits")
        return self

    def limits(self) -> tuple[float | None, float | None, float | None]:
        """Return lower limit, upper limit and target; None where there is none."""
        if self.nominal is None or self.tolerance is None:
            return self.lsl, self.usl, self.target
        target = self.nominal if self.target is None else self.target
        # as a drawing adds them: 2.11 - 0.25 is 1.86 and not 1.8599999999999999
        nominal, tolerance = Decimal(repr(self.nominal)), Decimal(repr(self.tolerance))
        return float(nominal - tolerance), float(nominal + tolerance), target


class SampleTable(TableModel, strict=True):
    """The samples of a user's table.

    Attributes
    ----------
    file : str or None
        A CSV or Parquet file, relative to the campaign file, with a column for each variable; read when the campaign is
        loaded.
    columns : dict of str to tuple of float, or None
        Instead: the values of each variable by its name.
    source : str
        Where the values come from.
    """

    file: Annotated[str | None, Field(min_length=1)] = None
    columns: dict[ShortName, Column] | None = None
    source: str = ""

    @model_validator(mode="after")
    def _one_origin(self) -> Self:
        if (self.file is None) == (self.columns is None):
            raise ValueError("give either file or columns: the table's samples have one origin")
        lengths = {name: len(column) for name, column in (self.columns or {}).items()}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(f"columns of different lengths ({told}); every row needs a value of each variable")
        return self


class CampaignSpec(TableModel, strict=True):
    """A campaign: which mechanism, which inputs vary and how, the limits of its responses, how many samples.

    Attributes
    ----------
    format : int
        Version of this file format.
    name : str
        Letters, digits, ``-`` and ``_``: the beginning of the campaign's id, which names its folder.
    title : str
        Title of the report.
    mechanism : str
        ShortName of a shipped mechanism, or path of a file relative to the campaign file.
    bench : str or None
        The test bench of the mechanism it is simulated on.
    samples : int
        Number of samples, the first of an endless sequence.
    seed : int
        Seed of that sequence.
    sampler : str
        How samples are drawn: ``random`` (independent); ``lhs``, ``sobol``, ``halton`` (evenly spread); ``saltelli``
        (designed for total indices); ``worst_case`` (all corners of the variables' ranges, and their middle);
        ``grid``; ``list`` (a user's table).
    simulation : SimulationSettings
        Settings of every run that replace the mechanism's own.
    failures : Failures
        What to do about runs that fail.
    execution : Execution
        What one run may cost.
    stop : Stop or None
        When the campaign ends before its last sample.
    header : dict of str to str
        Free lines for the head of the report: part, author, revision, ...
    variables : dict of str to Distribution
        The inputs that vary. The name is the key of the mechanism it sets, unless ``target`` says another.
    correlations : tuple of (str, str, float), or None
        Pairs of variables with Spearman's rank correlation.
    grid : dict of str to int or tuple of float, or None
        Of sampler ``grid``: how many levels each variable has, or which.
    table : SampleTable or None
        Of sampler ``list``: the samples.
    responses : dict of str to Response
        Limits by name of the mechanism's response. Responses not named are reported without limits.
    """

    format: Literal[1]
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,59}$")]
    title: str = ""
    mechanism: ShortName
    bench: ShortName | None = None
    samples: Annotated[int, Field(ge=1, le=100_000_000)]
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    sampler: SamplerName = "random"
    simulation: SimulationSettings = SimulationSettings()
    failures: Failures = Failures()
    execution: Execution = Execution()
    stop: Stop | None = None
    header: Annotated[dict[str, str], Field(default_factory=dict)]
    variables: Annotated[dict[ShortName, Variable], Field(min_length=1)]
    correlations: Annotated[tuple[Correlation, ...], Field(strict=False)] | None = None
    grid: dict[ShortName, Levels] | None = None
    table: SampleTable | None = None
    responses: Annotated[dict[ShortName, Response], Field(default_factory=dict)]

    @model_validator(mode="before")
    @classmethod
    def _samples_of_a_stop(cls, data: Any) -> Any:
        """Let a stopping rule's ``max_samples`` be a number of samples too; the smaller of both holds."""
        stop = data.get("stop") if isinstance(data, dict) else None
        most = stop.get("max_samples") if isinstance(stop, dict) else None
        given = data.get("samples", most) if isinstance(most, int) else None
        return {**data, "samples": min(given, most)} if isinstance(given, int) and isinstance(most, int) else data

    @model_validator(mode="after")
    def _samples_can_be_drawn(self) -> Self:
        check_sampling(self)
        return self

    def targets(self) -> dict[str, str]:
        """Return which key of the mechanism each variable sets, by variable name."""
        return {name: variable.target or name for name, variable in self.variables.items()}


def campaign_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file."""
    return CampaignSpec.model_json_schema()
