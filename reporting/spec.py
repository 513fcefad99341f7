"""Data about a campaign that a report needs besides its rows, as plain frozen classes.

The rows hold the results; these classes hold the request: limits, distributions, header, provenance, the design of the
samples, what is the same in every run, and a drawing of the mechanism. The caller fills them in; reporting never reads
a campaign or mechanism file.
"""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from reporting.errors import ReportError
from reporting.format_numbers import plain

Points = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Design:
    """Description of samples drawn by one sampler.

    Attributes
    ----------
    production : bool
        Whether the samples represent production: only then are sigma and capability meaningful.
    text : str
        Consequences for the reader of the report.
    """

    production: bool
    text: str


INDEPENDENT = Design(True, "Independent random samples, as the intervals assume.")


@dataclass(frozen=True)
class Assumption:
    """A quantity that is the same in every run.

    Attributes
    ----------
    group : str
        Heading under which it is listed, such as "Friction and impact".
    name : str
        Name in words, such as "stiffness of spring A3".
    value : float, tuple of float, or str
        A number, the components of a vector, or a text.
    unit : str
        Unit of the value, "1" for a pure number, empty for a text.
    key : str
        Key in the mechanism file; empty if it has none.
    """

    group: str
    name: str
    value: float | tuple[float, ...] | str
    unit: str
    key: str


class DrawnLine(NamedTuple):
    """A line through points; ``style`` is "thin", "thick", "dashed" or "arrow", with its head at the last point."""

    points: Points
    colour: str
    style: str


class DrawnWords(NamedTuple):
    """Lines of text centred at (x, y), one below the other; ``bold`` for the name of a response."""

    x: float
    y: float
    lines: tuple[str, ...]
    colour: str
    bold: bool


class LegendEntry(NamedTuple):
    """A response: its name, its title, what it measures or where, and its colour; empty if it has no place."""

    name: str
    title: str
    value: str
    colour: str


@dataclass(frozen=True)
class MechanismDrawing:
    """The mechanism and what its responses measure, on a canvas with the origin at its upper left corner."""

    width: float  # of the canvas
    height: float
    text: float  # font size
    areas: tuple[tuple[Points, str], ...]  # outlines of moving bodies, and their colours "#rrggbb"
    strokes: tuple[DrawnLine, ...]
    dots: tuple[tuple[float, float, str], ...]  # x, y, colour
    words: tuple[DrawnWords, ...]
    legend: tuple[LegendEntry, ...]  # one entry per response


@dataclass(frozen=True)
class ResponseSpec:
    """A functional condition and the limits it must keep.

    Attributes
    ----------
    name : str
        Column of the table.
    title : str
        Description in words.
    unit : str
        Unit of the column and of the limits, "1" if it has none.
    lsl, usl : float or None
        Lower and upper specification limit; None for a side without a limit.
    target : float or None
        Target value, for Cpm.
    source : str
        Where the limits come from. A text that starts with "assumption" marks them as assumed on the page.
    requirement : float
        Index from which on the response is capable.
    characteristic_class : str
        Name of the class that requires it, such as "critical"; empty without one.
    index : str
        The index that decides: "share" (of the share beyond the worse limit), "cpk" or "percentile" (ISO 22514-2).
    boundary : str
        "lower" or "upper" if that limit is a bound that no value can pass, as 0 for a gap: it has no index and no share
        beyond it, unless a value does pass it; else empty.
    historical : (float, float) or None
        Mean and sigma that the process is known to have, in the unit of the column.
    resolution, relative_resolution : float
        Largest meaningless difference between two values, because it is within the solver's tolerances: in the unit
        of the column, and as a share of the largest value.
    gauge_sigma, gauge_freedom : float or None
        Standard deviation of the measuring system, and its degrees of freedom, None where it is known exactly.
    uncertainty : float or None
        Expanded uncertainty of a measurement, in the unit of the column.
    """

    name: str
    title: str
    unit: str
    lsl: float | None
    usl: float | None
    target: float | None
    source: str
    resolution: float = 0.0
    relative_resolution: float = 0.0
    requirement: float = 1.33
    index: str = "share"
    boundary: str = ""
    historical: tuple[float, float] | None = None
    gauge_sigma: float | None = None
    gauge_freedom: float | None = None
    uncertainty: float | None = None
    characteristic_class: str = ""


@dataclass(frozen=True)
class VariableSpec:
    """A sampled variable and its requested distribution.

    Attributes
    ----------
    name : str
        Column of the table.
    unit : str
        Unit of the column, "1" if it has none.
    distribution : str
        The distribution in words, such as "truncated normal(0.07, 0.0175) on [0.01, 0.13]".
    lower, upper : float or None
        Bounds of the distribution; None where it is unbounded.
    mean, std : float
        Moments of the requested distribution, after truncation.
    density : tuple of (float, float)
        Points (value, density [1/unit]) of the requested density curve; empty for a constant.
    key : str
        Key of the variable in `clearcap simulate --set`; if empty, the name is the key.
    cdf : tuple of (float, float)
        Points (value, requested probability of values up to it), increasing; may be empty.
    batch : int
        Number of consecutive samples that form one production batch and share a shift; 0 without batches.
    """

    name: str
    unit: str
    distribution: str
    lower: float | None
    upper: float | None
    mean: float
    std: float
    density: tuple[tuple[float, float], ...]
    key: str = ""
    cdf: tuple[tuple[float, float], ...] = ()
    batch: int = 0


NELSON = ("nelson 1", "nelson 2", "nelson 3")


@dataclass(frozen=True)
class ChartPlan:
    """Which control chart measured values get."""

    chart: str = ""  # "i-mr", "xbar-r", "xbar-s" or "ewma"; if empty, subgroups decide
    rules: tuple[str, ...] = NELSON  # tests, keys of `reporting.capability.row_order.RULES`
    weight: float = 0.2  # of the newest point in a moving average


@dataclass(frozen=True)
class ProposalPart:
    """A component of importance sampling: the region where it draws, in standard scores of the variables."""

    share: float  # of the samples that it draws
    scale: float  # standard deviation of all scores
    shift: tuple[tuple[str, float], ...]  # centre of the score of each variable whose centre is not 0
    source: str = ""  # target of the component, in words


@dataclass(frozen=True)
class ReportSpec:
    """Everything that a report needs besides the table.

    Attributes
    ----------
    title : str
        Heading of the report.
    campaign : str
        Campaign id.
    header : dict of str to str
        Free text shown under the title (part, author, revision, conclusion), in this order.
    responses : tuple of ResponseSpec
    variables : tuple of VariableSpec
    provenance : dict of str to str
        Data needed to repeat the campaign (versions, hashes, seed, host, command), in this order.
    requested : int
        Number of samples requested.
    simulate : str
        The command that repeats a sample, without its `--set` options. If empty: `clearcap simulate` with the
        provenance's "mechanism", or with the campaign's id if there is no such entry.
    sampler : str
        Name of the sampler that drew the samples.
    design : Design
        How the samples were drawn, and to what extent the intervals of this report hold for them. Samples of sampler
        "random" are independent; any other sampler needs a design of its own.
    corners : bool
        Whether the samples are the corners of the variables' ranges, from which the worst case is taken.
    replay : str
        The command that repeats a sample of the campaign, without the sample number; may be empty.
    correlations : tuple of (str, str, float)
        Pairs of variables and their requested rank correlation (Spearman).
    production_batch_column : str
        Column with the number of each sample's production batch; empty without batches.
    stop : str
        Result of the campaign's stopping rule, in words; empty without a rule.
    designed : tuple of str, or None
        The k variables of Saltelli's design, in order; None if the samples are not such a design. Sample s belongs
        to row s // (k + 2). s % (k + 2) is the run within the row: 0 of A, 1 of B, 2 + j of A with variable j of B.
    ordered : bool
        Whether the rows are in the order in which parts were made, so that a drift over them means something. Samples
        that are drawn by their numbers have no such order.
    min_ok : float
        Smallest share of ok samples among the finished ones for which there are verdicts; 0 to 1.
    max_not_assemblable : float or None
        Largest share of samples whose parts cannot be assembled; None: they count among the failed samples.
    proposal : tuple of ProposalPart
        Components of importance sampling; empty if samples have no weights. The rows then have the columns
        "component" (number of a part, from 1; 0 for the distributions themselves), "log_weight" and "aimed" (beyond
        three quarters of the way to a part's centre).
    author : str
        Person responsible for the campaign; may be empty.
    ended : str
        Time at which the last sample was computed, as text; empty if unknown.
    written : str
        Time at which the report is written, as text: the only part of a report that depends on it.
    assumptions : tuple of Assumption
        Quantities that are the same in every run.
    drawing : MechanismDrawing or None
        The mechanism and what its responses measure.
    drawing_note : str
        Why there is no drawing; may be empty.
    measured : bool
        Whether the rows are measured parts: the report then says nothing of runs and inputs, and first of all whether
        the process is stable.
    subgroup_column : str
        Column with the number of each part's rational subgroup; empty without subgroups.
    charts : ChartPlan
        The control charts of measured parts.
    """

    title: str
    campaign: str
    header: dict[str, str]
    responses: tuple[ResponseSpec, ...]
    variables: tuple[VariableSpec, ...]
    provenance: dict[str, str]
    requested: int
    simulate: str = ""
    sampler: str = "random"
    design: Design = INDEPENDENT
    corners: bool = False
    replay: str = ""
    correlations: tuple[tuple[str, str, float], ...] = ()
    production_batch_column: str = ""
    stop: str = ""
    designed: tuple[str, ...] | None = None
    proposal: tuple[ProposalPart, ...] = ()
    author: str = ""
    ended: str = ""
    written: str = ""
    assumptions: tuple[Assumption, ...] = ()
    drawing: MechanismDrawing | None = None
    drawing_note: str = ""
    min_ok: float = 0.99
    max_not_assemblable: float | None = None
    ordered: bool = True
    measured: bool = False
    subgroup_column: str = ""
    charts: ChartPlan = ChartPlan()

    def __post_init__(self) -> None:
        """Raise ReportError if samples that are not independent would be treated as independent."""
        independent = self.sampler == ReportSpec.sampler and not self.corners and self.designed is None
        if not independent and self.design == INDEPENDENT:
            raise ReportError(f"sampler {self.sampler}: the samples are not described; describe them in design")

    def command(self, values: Mapping[str, float]) -> str:
        """Return the command that simulates one sample with the given values of the variables, in full precision."""
        start = self.simulate or f"clearcap simulate {shlex.quote(self.provenance.get('mechanism', self.campaign))}"
        keys = (f"{v.key or v.name}={plain(values[v.name])}" for v in self.variables)
        return " ".join([start, *(f"--set {shlex.quote(key)}" for key in keys)])
