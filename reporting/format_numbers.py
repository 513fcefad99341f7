"""Numbers as text: few digits, but never so few that a value reaches or crosses a limit.

A Cpk of 1.3299 is not printed as 1.33, a largest value of 15.9998 N not as 16.00 N, a yield of 99.9998 % not as 100 %.
"""

import math
from collections.abc import Iterable

NONE = "–"
_MOST_DECIMALS = 17
# A larger index only says that the limits are far away: no sample can distinguish 400 from 40,000.
MOST_INDEX = 100.0


def plain(value: float | None) -> str:
    """Return the shortest text that reads back as the same number, without a trailing ".0"."""
    if value is None:
        return NONE
    mantissa, mark, exponent = repr(float(value)).removesuffix(".0").partition("e")
    return f"{mantissa}e{int(exponent)}" if mark else mantissa


def decimals_for(scale: float | None, significant: int = 3) -> int:
    """Return the number of decimals that shows `significant` digits of a number of magnitude `scale`."""
    if not scale or not math.isfinite(scale):
        return significant
    return min(max(significant - 1 - math.floor(math.log10(abs(scale))), 0), 12)


def fixed(value: float | None, decimals: int = 3, limits: Iterable[float | None] = ()) -> str:
    """Return `value` with `decimals` decimals, or more if it would otherwise reach or cross one of `limits`."""
    if value is None:
        return NONE
    fences = [limit for limit in limits if limit is not None]
    for places in range(decimals, _MOST_DECIMALS + 1):
        text = f"{value:.{places}f}"
        if all(_side(float(text), limit) == _side(value, limit) for limit in fences):
            return text.removeprefix("-") if float(text) == 0 else text
    return plain(value)


def index(value: float | None, most: float = math.inf) -> str:
    """Return a capability index with three decimals, more if it would otherwise reach or cross 1.00 or 1.33.

    An index above `most` or `MOST_INDEX` is only reported as larger than that.
    """
    most = min(most, MOST_INDEX)
    if value is not None and abs(value) > most:
        return f"> {most:.2f}" if value > 0 else f"< -{MOST_INDEX:.2f}" if value < -MOST_INDEX else fixed(value, 3)
    return fixed(value, 3, (1.0, 1.33))


def deciding_index(value: float | None, low: float | None) -> str:
    """Return the index that decides a verdict; where no reject gives it a value, that it exceeds its lower end."""
    if value is None:
        return "-" if low is None else f"> {index(low)}"
    return index(value)


def index_interval(ends: tuple[float | None, float | None], most: float = math.inf) -> str:
    """Return the interval of a capability index; an end of None is unbounded, one above `most` is only "larger"."""
    low, high = ends
    if low is None:
        return "no bounds" if high is None else f"{index(high, most)} or less"
    if high is None or low > min(most, MOST_INDEX):
        return index(low, most) if low > min(most, MOST_INDEX) else f"{index(low, most)} or more"
    return f"{index(low, most)} to {index(high, most)}"


def z_score(value: float | None, most: float = math.inf) -> str:
    """Return a distance in sigmas with three decimals; above `most` only that it is larger."""
    return fixed(value, 3) if value is None or value <= most else f"> {most:.2f}"


def ppm(value: float | None, least: float = 0.0) -> str:
    """Return parts per million: a whole number above 100, three digits below, never 0 unless the value is 0.

    A value below `least` is only reported as less than that.
    """
    if value is None:
        return NONE
    if value < least:
        return f"< {grouped(round(float(f'{least:.2g}')))}" if least >= 100 else f"< {significant(least, 2)}"
    if 0 < value < 1e-3:
        return "< 0.001"
    decimals = 0 if value == 0 or value >= 100 else decimals_for(value)
    return grouped(fixed(value, decimals, (0.0, 1e6)))


def percent(share: float | None) -> str:
    """Return a share as percent with two decimals, never 0 or 100 unless it is exactly that."""
    return NONE if share is None else f"{fixed(100 * share, 0 if share in (0, 1) else 2, (0.0, 100.0))}\u00a0%"


def short_percent(share: float) -> str:
    """Return a share as percent, without decimals if it is whole, never 0 or 100 unless it is exactly that."""
    return percent(share).replace(".00\u00a0", "\u00a0")


def part(share: float | None) -> str:
    """Return an estimated share as percent with one decimal; below 0.05 % it is 0."""
    if share is None:
        return NONE
    return "0\u00a0%" if share < 0.0005 else f"{100 * share:.{0 if share >= 0.9995 else 1}f}\u00a0%"


def significant(value: float | None, digits: int = 3) -> str:
    """Return `value` with `digits` significant digits, with an exponent if it is very small or large."""
    if value is None:
        return NONE
    if value == 0:
        return "0"
    mantissa, mark, exponent = f"{value:#.{digits}g}".removesuffix(".").partition("e")
    return f"{mantissa}e{int(exponent)}" if mark else mantissa


def grouped(number: int | str) -> str:
    """Return a number with a narrow space between thousands."""
    whole, point, rest = str(number).partition(".")
    return f"{int(whole):,}".replace(",", "\u202f") + point + rest


def probability(value: float | None) -> str:
    """Return a p-value with two digits, or a bound if it is small."""
    if value is None:
        return NONE
    return "< 0.0001" if value < 1e-4 else f"{value:.2g}"


def duration(seconds: float | None) -> str:
    """Return a time in a suitable unit."""
    if seconds is None:
        return NONE
    for size, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def _side(value: float, limit: float) -> int:
    """Return -1, 0 or 1 for a value below, on or above the limit."""
    return int(value > limit) - int(value < limit)
