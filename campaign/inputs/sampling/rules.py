"""What a spec must say for its samples to be drawn; what is wrong is refused with key, value and remedy."""

from collections import Counter
from math import isfinite
from typing import TYPE_CHECKING

from campaign.inputs.distributions import Constant, Continuous
from campaign.inputs.sampling import lhs, varied
from campaign.inputs.sampling.correlation import LEAST_EIGENVALUE, largest_scale, smallest_eigenvalue
from campaign.inputs.sampling.enumerated import grid_size
from campaign.inputs.sampling.saltelli import MOST_VARIABLES, nearest_sizes
from engine.mechanism.faults import did_you_mean

if TYPE_CHECKING:
    from campaign.spec.campaign_file import CampaignSpec

ENUMERATING = ("worst_case", "grid", "list")


def check_correlations(spec: "CampaignSpec") -> None:
    """Check the correlations between variables.

    Raises
    ------
    ValueError
        If one is of an unknown variable, a constant, or a variable with itself, is given twice, or they cannot hold
        together.
    """
    pairs = Counter(frozenset((a, b)) for a, b, _ in spec.correlations or ())
    for a, b, rank in spec.correlations or ():
        told = f'correlations, ["{a}", "{b}", {rank:g}]'
        for name in (a, b):
            if name not in spec.variables:
                names = list(spec.variables)
                raise ValueError(f"{told}: no variable {name}; allowed: {', '.join(names)}{did_you_mean(name, names)}")
            if isinstance(spec.variables[name], Constant):
                raise ValueError(f"{told}: {name} is a constant, which varies with nothing; remove the entry")
        if a == b:
            raise ValueError(f"{told}: a variable with itself; name two variables")
        if pairs[frozenset((a, b))] > 1:
            raise ValueError(f"{told}: this pair is given more than once; keep one entry")
    if spec.correlations and (smallest := smallest_eigenvalue(spec.correlations)) < LEAST_EIGENVALUE:
        raise ValueError(
            f"correlations: they cannot hold together, the matrix is not positive definite (smallest eigenvalue"
            f" {smallest:.3g}); all of them multiplied by {largest_scale(spec.correlations):g} can"
        )


def check_sampler(spec: "CampaignSpec") -> None:
    """Check what the sampler needs, and that nothing is said that it would pass over.

    Raises
    ------
    ValueError
        With the key at fault.
    """
    for key, sampler in (("grid", "grid"), ("table", "list")):
        if getattr(spec, key) is not None and spec.sampler != sampler:
            raise ValueError(f'{key} is only read by sampler "{sampler}"; write sampler = "{sampler}" or remove it')
    if spec.sampler in ENUMERATING:
        _check_nothing_random(spec)
    match spec.sampler:
        case "lhs" if spec.samples > lhs.LARGEST:
            raise ValueError(
                f"samples = {spec.samples}: sampler lhs allows up to {lhs.LARGEST}, kept in memory; write sampler ="
                ' "sobol", which has no such limit'
            )
        case "saltelli":
            _check_design(spec)
        case "worst_case":
            _check_corners(spec)
        case "grid":
            _check_grid(spec)
        case "list":
            _check_list(spec)


def _check_nothing_random(spec: "CampaignSpec") -> None:
    if what := _what_ties(spec):
        raise ValueError(f"{what}: sampler {spec.sampler} draws nothing at random and would pass it over; remove it")


def _what_ties(spec: "CampaignSpec") -> str:
    """Return the key that makes variables, or samples, depend on each other; empty where none does."""
    shifted = [name for name, v in spec.variables.items() if isinstance(v, Continuous) and v.batch]
    if spec.correlations:
        return "correlations"
    return f"variables.{shifted[0]}.batch" if shifted else ""


def _check_design(spec: "CampaignSpec") -> None:
    if what := _what_ties(spec):
        raise ValueError(
            f"{what}: sampler saltelli changes one variable and leaves the others, so they must be independent; remove"
            ' it, or write sampler = "sobol"'
        )
    if spec.stop:
        raise ValueError(
            "stop: samples of sampler saltelli repeat each other's values, so the first so many are no sample that an"
            ' interval could be judged by; remove stop, or write sampler = "sobol"'
        )
    k = len(varied(spec))
    if not 0 < k <= MOST_VARIABLES:
        raise ValueError(
            f"variables: {k} of them vary; sampler saltelli allows 1 to {MOST_VARIABLES}, each two dimensions of a"
            ' Sobol sequence; change their number, or write sampler = "random"'
        )
    sizes = nearest_sizes(k, spec.samples)
    if spec.samples not in sizes:
        raise ValueError(
            f"samples = {spec.samples}: sampler saltelli has n ({k} + 2) samples for {k} variables, n a power of 2;"
            f" write samples = {' or '.join(map(str, sizes))}"
        )


def _check_corners(spec: "CampaignSpec") -> None:
    _check_ends(spec, list(spec.variables))
    corners = 2 ** len(spec.variables) + 1
    if spec.samples != corners:
        raise ValueError(
            f"samples = {spec.samples}: sampler worst_case: {len(spec.variables)} variables have {corners - 1} corners"
            f" and a middle; write samples = {corners}"
        )


def _check_ends(spec: "CampaignSpec", names: list[str]) -> None:
    endless = [name for name in names if not all(map(isfinite, spec.variables[name].support()))]
    if endless:
        raise ValueError(
            f"sampler {spec.sampler} needs both ends of every variable; {', '.join(endless)} has none; give lower and"
            " upper" + (", or its levels" if spec.sampler == "grid" else "")
        )


def _check_grid(spec: "CampaignSpec") -> None:
    levels = spec.grid or {}
    names = varied(spec)
    _check_names(spec, "grid", list(levels), names, "give a number of levels, or the levels")
    _check_ends(spec, [name for name in names if isinstance(levels[name], int)])
    _check_bounds(spec, "grid", {name: level for name, level in levels.items() if isinstance(level, tuple)})
    size = grid_size(spec.variables, levels)
    if spec.samples != size:
        raise ValueError(f"samples = {spec.samples}: the grid has {size} points; write samples = {size}")


def _check_list(spec: "CampaignSpec") -> None:
    if spec.table is None:
        raise ValueError('table: missing; sampler "list" draws its rows; add table = {file = "..."}')
    if spec.table.columns is None:  # its file is still to be read
        return
    rows = spec.rows()
    _check_names(spec, "table.columns", list(rows), list(spec.variables), "add its column")
    _check_bounds(spec, "table.columns", rows)
    length = len(next(iter(rows.values())))
    if spec.samples > length:
        raise ValueError(f"samples = {spec.samples}: the table has {length} rows; write samples = {length} or fewer")


def _check_names(spec: "CampaignSpec", key: str, given: list[str], needed: list[str], remedy: str) -> None:
    """Refuse entries of what is no variable, and variables without an entry."""
    for name in given:
        if name not in spec.variables:
            raise ValueError(
                f"{key}.{name}: no variable of that name; allowed: {', '.join(needed)}{did_you_mean(name, needed)}"
            )
    for name in needed:
        if name not in given:
            raise ValueError(f"{key}.{name}: missing; {remedy}")


def _check_bounds(spec: "CampaignSpec", key: str, given: dict[str, tuple[float, ...]]) -> None:
    """Refuse values that the variable's distribution excludes."""
    for name, values in given.items():
        low, high = spec.variables[name].support()
        for row, value in enumerate(values):
            if not low <= value <= high:
                raise ValueError(
                    f"{key}.{name}: value {value:g} (number {row}) lies outside of the variable's ends, [{low:g},"
                    f" {high:g}]; correct it, or widen the variable"
                )
