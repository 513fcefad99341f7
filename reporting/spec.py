"""What the reporting room is told about a campaign: plain frozen data, no behaviour.

The table of samples says what came out; these classes say what was asked: limits, requested distributions,
header, provenance. Whoever calls fills them in; reporting never reads a campaign or a mechanism file.
"""

from dataclasses import dataclass

from reporting.designs import INDEPENDENT, Design
from reporting.errors import ReportError


@dataclass(frozen=True)
class ResponseSpec:
    """A functional condition and the limits it must keep.

    Attributes
    ----------
    name : str
        Column of the table.
    title : str
        What it is, in words.
    unit : str
        Unit of the column and of the limits, "1" if it has none.
    lsl, usl : float or None
        Lower and upper specification limit; None where that side is free.
    target : float or None
        Wanted value, for Cpm.
    source : str
        Where the limits come from. A text that starts with "assumption" marks them as assumed on the page.
    """

    name: str
    title: str
    unit: str
    lsl: float | None
    usl: float | None
    target: float | None
    source: str


@dataclass(frozen=True)
class VariableSpec:
    """A sampled input and the distribution that was asked for.

    Attributes
    ----------
    name : str
        Column of the table.
    unit : str
        Unit of the column, "1" if it has none.
    distribution : str
        The distribution in words, "truncated normal(0.07, 0.0175) on [0.01, 0.13]".
    lower, upper : float or None
        Bounds of the distribution; None where it is unbounded.
    mean, std : float
        Moments of the requested distribution, after truncation.
    density : tuple of (float, float)
        Points (value, density [1/unit]) of the requested density curve; empty for a constant.
    key : str
        What `clearcap simulate --set` calls it; empty: the name.
    cdf : tuple of (float, float)
        Points (value, requested probability of values up to it), rising; empty where they are not known.
    batch : int
        Consecutive samples that share a shift, a production batch; 0 without batches.
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


@dataclass(frozen=True)
class ReportSpec:
    """Everything a report needs beside the table.

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
        Versions, hashes, seed, host, command: what is needed to repeat the campaign, in this order.
    requested : int
        Number of samples asked for.
    simulate : str
        The command that repeats a sample, without its `--set` options; empty: `clearcap simulate` with the
        provenance's "mechanism", or with the campaign's id where there is none.
    sampler : str
        Name of the way in which the samples were drawn.
    design : Design
        What the samples are, and how far the intervals of this report hold for them; samples of sampler "random" are
        independent, samples of another one need a design of their own.
    corners : bool
        Whether the samples are the corners of the variables' ranges, over which the worst case is taken.
    replay : str
        The command that repeats a sample of the campaign, without the sample's number; empty: there is none.
    correlations : tuple of (str, str, float)
        Pairs of variables and the rank correlation (Spearman) asked for.
    production_batch_column : str
        Column with the number of the production batch each sample is in; empty without batches.
    stop : str
        What the campaign's stopping rule said, in words; empty without a rule.
    designed : tuple of str, or None
        The k variables of Saltelli's design, in its order, where samples are one: sample s belongs to row s // (k + 2),
        and s % (k + 2) says which of its runs it is, 0 A's, 1 B's, 2 + j A's with variable j of B. None where the
        samples are no such design.
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

    def __post_init__(self) -> None:
        """Raise ReportError if samples that are not independent would pass for such."""
        independent = self.sampler == ReportSpec.sampler and not self.corners and self.designed is None
        if not independent and self.design == INDEPENDENT:
            raise ReportError(f"sampler {self.sampler}: nothing says what its samples are; give design")
