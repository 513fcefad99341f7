"""The rows of a campaign, and those of its repeats, as checked arrays; no other module knows their columns.

Rows come as one table or as a stream of tables. Only the first messages of each status are stored, so that the texts of
a million rows are never in memory together. Repeats are samples that were simulated a second time with half the step.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from reporting.arrays import ROUNDING, Array, Columns, GrowingColumn
from reporting.errors import ReportError
from reporting.format_numbers import grouped, short_percent
from reporting.spec import ReportSpec, ResponseSpec

if TYPE_CHECKING:
    from typing import TypeAlias

    import pyarrow

    Rows: TypeAlias = pyarrow.Table | Iterable[pyarrow.Table]

CERTIFICATE = ("sample", "status", "message", "max_residual", "max_penetration", "settled")
OPTIONAL = "wall_s"
LIMITED, SHARES = ("max_residual", "max_penetration"), ("created_energy", "lost_energy")
KINETIC, TURN = "max_kinetic_energy", "max_turn"
LATER = (*SHARES, KINETIC, TURN)  # rows of earlier builds lack them
AT_IMPACT, AMBIGUOUS = "at_impact", "ambiguous"  # earlier builds have neither
IMPORTANCE = ("component", "log_weight", "aimed")
OK = "ok"
MESSAGES_KEPT = 20  # of each status
# Values beyond this have powers that are no numbers, and values closer to each other than this have none either.
LARGEST, SMALLEST = 1e30, 1e-30
_FEW = 1000  # values that mostly show how far they differ


@dataclass(frozen=True)
class Largest:
    """The largest number of a column of certificates over the ok rows; the column itself is not kept."""

    value: float = -math.inf
    sample: int = -1  # the first with this number
    stated: int = 0  # ok rows that have a number

    def or_of(self, values: Array, sample: NDArray[np.int64]) -> "Largest":
        """Return the largest of this one and of further ok rows, shape (n,); a number that is not finite is none."""
        stated = np.flatnonzero(np.isfinite(values))
        found = replace(self, stated=self.stated + stated.size)
        if not stated.size:
            return found
        row = int(stated[np.argmax(values[stated])])
        more = float(values[row]) > self.value
        return replace(found, value=float(values[row]), sample=int(sample[row])) if more else found


@dataclass(frozen=True)
class Samples:
    """One row per sample, as arrays."""

    sample: NDArray[np.int64]  # shape (n,), like all arrays here
    status: NDArray[np.int16]  # index into `statuses`
    statuses: tuple[str, ...]  # those that occur in the rows
    messages: dict[int, str]  # by sample number: the first 20 of each status except "ok"
    ok: NDArray[np.bool_]  # whether the status is "ok"
    # variables and responses by name, NaN where the table has none; a response is valid only where `ok`
    values: dict[str, Array]
    # Of the ok rows, whatever `where` leaves: "max_residual", "max_penetration", and where the rows have all columns of
    # `LATER`, "created_energy" and "lost_energy" as shares of the largest kinetic energy, and "max_turn"
    largest: dict[str, "Largest"]
    settled: NDArray[np.bool_]
    penetration_unit: str  # in the metadata of the column; empty without one
    production_batch: NDArray[np.int64] | None  # number of each sample's batch; None without batches
    run_seconds: float | None  # total time of the runs [s]; None if the rows do not state it
    # "component", "log_weight" and "aimed"; empty for others
    importance: dict[str, Array] = field(default_factory=dict)
    # Group of production batches of each sample, where variables have batches of different sizes: samples of different
    # groups share no shift. None where each production batch is such a group.
    lot: NDArray[np.int64] | None = None
    # By response: whether its value is a force at an impact, shape (n,); only responses with such values
    at_impact: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    # Whether motion would have solved the equations as well where the sample rests, shape (n,); None: not known
    ambiguous: NDArray[np.bool_] | None = None
    subgroup: NDArray[np.int64] | None = None  # number of each measured part's subgroup; None without subgroups

    @property
    def lots(self) -> NDArray[np.int64] | None:
        """Group of each sample; groups share no shift with each other. None without production batches."""
        return self.production_batch if self.lot is None else self.lot

    def having(self, status: str) -> NDArray[np.bool_]:
        """Return whether a row has a status, shape (n,)."""
        if status not in self.statuses:
            return np.zeros(self.status.size, np.bool_)
        return np.asarray(self.status == self.statuses.index(status))

    def rows_of(self, status: str) -> NDArray[np.intp]:
        """Return the indices of the rows with a status."""
        return np.flatnonzero(self.having(status))

    @cached_property
    def of_ok(self) -> Columns:
        """Variables and responses of the ok rows."""
        return Columns(self.values).where(self.ok)

    def where(self, rows: NDArray[np.bool_]) -> "Samples":
        """Return the samples for which the mask `rows`, shape (n,), is True."""
        of_rows: dict[str, Any] = {}
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                of_rows[name] = value[rows]
            elif isinstance(value, dict) and name not in ("messages", "largest"):
                of_rows[name] = {key: column[rows] for key, column in value.items()}
        return replace(self, **of_rows)


def read_samples(rows: "Rows", spec: ReportSpec) -> Samples:
    """Return the rows, one table or tables in the order of samples, as arrays; ReportError if they do not fit."""
    names = [*(v.name for v in spec.variables), *(r.name for r in spec.responses)]
    for r in spec.responses:
        for key, limit in (("lsl", r.lsl), ("usl", r.usl)):
            if limit is not None and math.isfinite(limit) and abs(limit) > LARGEST:
                raise ReportError(f"response {r.name}: {key} = {limit:g} is beyond {LARGEST:g}; give another unit")
    needed = [*names, "sample", "max_residual", "max_penetration", "settled"]
    needed += [spec.production_batch_column] if spec.production_batch_column else []
    needed += [spec.subgroup_column] if spec.subgroup_column else []
    needed += IMPORTANCE if spec.proposal else ()
    most = spec.requested
    columns = {name: GrowingColumn(np.float64, most) for name in needed if name not in CERTIFICATE}
    sample, status, settled = (
        GrowingColumn(np.int64, most),
        GrowingColumn(np.int16, most),
        GrowingColumn(np.bool_, most),
    )
    struck, ambiguous = GrowingColumn(np.int32, most), GrowingColumn(np.bool_, most)
    statuses, lists, messages = dict[str, int](), dict[str, int](), dict[str, dict[int, str]]()
    largest, later = dict.fromkeys((*LIMITED, *SHARES, TURN), Largest()), dict.fromkeys(LATER, False)
    unit, seconds = "", None
    for table in _tables(rows):
        _check_columns(table, spec, needed)
        unit = (table.schema.field("max_penetration").metadata or {}).get(b"unit", b"").decode() or unit
        for name, column in columns.items():
            column.add(_numbers(table, name))
        numbers, codes = _numbers(table, "sample").astype(np.int64), _statuses(table, statuses, messages)
        sample.add(numbers)
        status.add(codes)
        settled.add(_numbers(table, "settled") == 1.0)
        ok = codes == statuses.get(OK, -1)
        for name, values in _certificates(table, later):
            largest[name] = largest[name].or_of(values[ok], numbers[ok])
        if OPTIONAL in table.column_names:
            seconds = (seconds or 0.0) + float(np.nansum(_numbers(table, OPTIONAL)))
        if AT_IMPACT in table.column_names and AMBIGUOUS in table.column_names:
            struck.add(_codes(_strings(table, AT_IMPACT), lists))
            ambiguous.add(_numbers(table, AMBIGUOUS) == 1.0)
    _check_rows(sample.array, spec.requested)
    sizes = [variable.batch for variable in spec.variables]
    batch, subgroup = (
        columns.pop(name).array.astype(np.int64) if name else None
        for name in (spec.production_batch_column, spec.subgroup_column)
    )
    remarked = struck.array.size == sample.array.size
    return Samples(
        sample=sample.array,
        status=status.array,
        statuses=tuple(statuses),
        messages={number: text for kept in messages.values() for number, text in kept.items()},
        ok=status.array == statuses.get(OK, -1),
        largest=largest if all(later.values()) else {name: largest[name] for name in LIMITED},
        settled=settled.array,
        penetration_unit=unit,
        production_batch=batch,
        subgroup=subgroup,
        lot=whole_lots(sample.array, sizes),
        run_seconds=seconds,
        importance={name: columns.pop(name).array for name in IMPORTANCE} if spec.proposal else {},
        values={name: column.array for name, column in columns.items()},
        at_impact=_marked(struck.array, lists) if remarked else {},
        ambiguous=ambiguous.array if remarked and sample.array.size else None,
    )


def _certificates(table: "pyarrow.Table", later: dict[str, bool]) -> "Iterator[tuple[str, Array]]":
    """Yield the columns of which only the largest number is kept; note in `later` which of `LATER` have a number."""
    for name in LIMITED:
        yield name, _numbers(table, name)
    found = {name: _numbers(table, name) for name in LATER if name in table.column_names}
    for name, values in found.items():
        later[name] |= bool(np.isfinite(values).any())
    nothing = np.full(table.num_rows, np.nan)
    kinetic, shares = found.get(KINETIC, nothing), np.zeros((len(SHARES), table.num_rows))  # 0 of runs without motion
    for name, share in zip(SHARES, shares, strict=True):
        np.divide(found.get(name, nothing), kinetic, out=share, where=kinetic != 0.0)
    shares[:, ~np.isfinite(shares).all(axis=0)] = np.nan  # a row states both or neither
    yield from zip(SHARES, shares, strict=True)
    yield TURN, found.get(TURN, nothing)


def _codes(words: "pyarrow.ChunkedArray", codes: dict[str, int]) -> NDArray[np.int32]:
    """Return the texts of a column, an empty one for null, as codes; add new texts to `codes`."""
    import pyarrow

    encoded = words.fill_null("").dictionary_encode().combine_chunks()
    encoded = encoded if isinstance(encoded, pyarrow.DictionaryArray) else encoded.chunk(0)
    translate = [codes.setdefault(word, len(codes)) for word in encoded.dictionary.to_pylist()]
    found: NDArray[np.int32] = np.array([*translate, 0], np.int32)[
        encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64)
    ]
    return found


def _marked(codes: NDArray[np.int32], lists: dict[str, int]) -> dict[str, NDArray[np.bool_]]:
    """Return for each name in lists of names, separated by commas and given by their codes, which of them have it."""
    names = sorted({name for text in lists if text for name in text.split(",")})
    return {name: np.array([name in text.split(",") for text in lists], bool)[codes] for name in names}


def whole_lots(sample: NDArray[np.int64], sizes: Iterable[int]) -> NDArray[np.int64] | None:
    """Return the lot of each sample number; samples of different lots share no shift. None without lots.

    Where variables have lots of different sizes, a lot ends where one of each ends: at multiples of all sizes.
    """
    given = [size for size in sizes if size > 0]
    if not given:
        return None
    # A common multiple beyond the range of sample numbers makes all samples one lot.
    return np.asarray(sample, np.int64) // min(math.lcm(*given), np.iinfo(np.int64).max)


def _tables(rows: "Rows") -> "Iterable[pyarrow.Table]":
    """Return the tables; a single table is sorted by sample."""
    import pyarrow

    if not isinstance(rows, pyarrow.Table):
        return rows
    return [rows.sort_by("sample") if rows.column_names.count("sample") == 1 else rows]


def _check_columns(table: "pyarrow.Table", spec: ReportSpec, needed: list[str]) -> None:
    """Raise ReportError unless the table has every column of the report once."""
    names = [variable.name for variable in spec.variables] + [response.name for response in spec.responses]
    repeated = [name for name, count in Counter([*names, *CERTIFICATE]).items() if count > 1]
    if repeated:
        raise ReportError(f"{repeated[0]!r} names more than one variable, response or column of the certificate")
    present = Counter(table.column_names)
    for name in dict.fromkeys((*CERTIFICATE, *needed)):
        if present[name] != 1:
            what = "is missing from" if present[name] == 0 else f"appears {present[name]} times in"
            raise ReportError(
                f"column {name!r} {what} the table of samples, which has "
                f"{', '.join(table.column_names) or 'none'}; give the table of the campaign the report is for"
            )


def _check_rows(sample: NDArray[np.int64], requested: int) -> None:
    """Raise ReportError if samples are repeated or out of order, or if there are more than requested."""
    if requested < 1:
        raise ReportError(f"requested = {requested}: a campaign has at least 1 sample")
    steps = np.diff(sample)
    if np.any(steps == 0):
        raise ReportError(f"sample {sample[int(np.argmin(steps != 0))]} appears more than once; give it one row")
    if np.any(steps < 0):
        at = int(np.argmax(steps < 0))
        raise ReportError(f"sample {sample[at + 1]} comes after {sample[at]}; give tables in the order of the samples")
    if sample.size > requested:
        raise ReportError(
            f"the table has {sample.size} rows, but the campaign has only {requested} samples; plan more samples"
        )


def _statuses(table: "pyarrow.Table", codes: dict[str, int], messages: dict[str, dict[int, str]]) -> NDArray[np.int16]:
    """Return the status of each row as its code; add new statuses to `codes`, and first messages by their status."""
    import pyarrow

    words = _strings(table, "status")
    empty = words.null_count or pyarrow.compute.any(pyarrow.compute.equal(words, "")).as_py()
    if empty:
        at = next(i for i, word in enumerate(words.to_pylist()) if not word)
        raise ReportError(
            f"sample {table['sample'][at].as_py()} has no status; repair its row or compute its batch again"
        )
    status = _codes(words, codes).astype(np.int16)
    texts, sample = _strings(table, "message"), table["sample"]
    for word, code in codes.items():
        kept = messages.setdefault(word, {})
        for row in np.flatnonzero(status == code)[: MESSAGES_KEPT - len(kept)] if word != OK else ():
            kept[sample[int(row)].as_py()] = texts[int(row)].as_py() or ""
    return status


def _numbers(table: "pyarrow.Table", name: str) -> Array:
    """Return a column as floats, with NaN for null."""
    import pyarrow

    column = table.column(name)
    kind = column.type
    if pyarrow.types.is_null(kind):  # every run of the table failed
        return np.full(len(column), np.nan)
    if not (pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind) or pyarrow.types.is_boolean(kind)):
        raise ReportError(f"column {name!r} holds {kind}; it must hold numbers")
    if name == "sample" and column.null_count:
        raise ReportError(f"column 'sample' has {column.null_count} empty rows; every row needs its number")
    values: Array = column.cast(pyarrow.float64(), safe=False).to_numpy()  # of whole numbers beyond 2^53 the nearest
    # Both ends, NaN left out, mostly show it; infinite ones do not.
    within = values.size and np.fmin.reduce(values) >= -LARGEST and np.fmax.reduce(values) <= LARGEST
    if not within and np.any(np.isfinite(values) & (np.abs(values) > LARGEST)):
        raise ReportError(f"column {name!r} has values beyond {LARGEST:g}, whose powers overflow; give another unit")
    return values


def _strings(table: "pyarrow.Table", name: str) -> "pyarrow.ChunkedArray":
    import pyarrow

    column = table.column(name)
    kind = column.type
    if pyarrow.types.is_dictionary(kind):
        kind = kind.value_type
    if not (pyarrow.types.is_string(kind) or pyarrow.types.is_large_string(kind) or pyarrow.types.is_null(kind)):
        raise ReportError(f"column {name!r} holds {kind}; it must hold text")
    return column.cast(pyarrow.string())


@dataclass(frozen=True)
class Repeats:
    """The repeats of a campaign, one entry per repeat."""

    # the sample that is repeated, shape (m,)
    sample: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    ok: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))  # whether the repeat succeeded
    values: dict[str, Array] = field(default_factory=dict)  # responses by name, shape (m,), NaN where there is no value
    planned: int = 0  # samples to be repeated
    remedy: str = ""  # sentence that says how to get more repeats; may be empty


def read_repeats(table: "pyarrow.Table | None", responses: Sequence[str], planned: int, remedy: str) -> Repeats:
    """Return the repeats of a table with ``sample``, ``status`` and the responses; ReportError if it does not fit."""
    if table is None:
        return Repeats(planned=planned, remedy=remedy)
    import pyarrow

    try:
        sample = table["sample"].to_numpy().astype(np.int64)
        ok = np.array([status == OK for status in table["status"].to_pylist()], np.bool_)
        values = {name: np.asarray(table[name].cast(pyarrow.float64()).to_numpy(), np.float64) for name in responses}
    except (KeyError, pyarrow.ArrowInvalid) as error:
        raise ReportError(f"the table of repeats cannot be read: {error}; give that of the campaign") from error
    if np.unique(sample).size < sample.size:
        raise ReportError("a sample is repeated more than once; give each repeat one row")
    return Repeats(sample, ok, values, planned, remedy)


# Values that differ by rounding only: no sigma, index or histogram is computed from the last bits of a constant.
#
# Two computations of the same number differ in their last bits, and two runs of a simulation differ within the
# tolerances of its solver: a length by the tolerated penetration. Values that differ by no more are treated as one
# value.


def leveled_samples(samples: Samples, spec: ReportSpec) -> tuple[Samples, dict[str, float]]:
    """Return the samples with what is constant except for rounding made constant, and what each response lost."""
    values, removed = dict(samples.values), dict[str, float]()
    for response in spec.responses:
        rows = samples.ok & np.isfinite(values[response.name])
        if _far_from_leveled(values[response.name], rows, response):
            continue
        x = values[response.name][rows]
        one = leveled(x, response.resolution, response.relative_resolution)
        if one is not x:
            removed[response.name] = float(np.ptp(x))
            column = values[response.name].copy()
            column[rows] = one
            values[response.name] = column
    for variable in spec.variables:
        x = values[variable.name]
        if 0.0 < np.nanmax(x, initial=-np.inf) - np.nanmin(x, initial=np.inf) <= SMALLEST:
            values[variable.name] = np.where(np.isnan(x), x, np.nanmedian(x))
    return replace(samples, values=values), removed


def _far_from_leveled(values: Array, rows: NDArray[np.bool_], response: ResponseSpec) -> bool:
    """Return whether the first of the rows already differ by more than rounding could."""
    few = values[:_FEW][rows[:_FEW]]
    largest = max(float(np.fmax.reduce(values)), -float(np.fmin.reduce(values))) if few.size else math.nan
    negligible = _negligible(largest, response.resolution, response.relative_resolution)
    return few.size > 1 and math.isfinite(negligible) and float(np.ptp(few)) > negligible


def _negligible(largest: float, resolution: float, relative: float) -> float:
    """Return the largest difference between values that is rounding."""
    return max(resolution, max(relative, ROUNDING) * largest, SMALLEST)


def leveled(x: Array, resolution: float = 0.0, relative: float = 0.0) -> Array:
    """Return the finite values, or an array of their common value if they differ by resolution or rounding only."""
    if x.size < 2:
        return x
    low, high = float(x.min()), float(x.max())
    negligible = _negligible(max(abs(low), abs(high)), resolution, relative)
    if not 0.0 < high - low <= negligible:
        return x
    # Keep only meaningful decimals: 1.0000000000000002 becomes 1, and 3e-15 beside a limit of 1e-3 becomes 0.
    decimals = min(-math.floor(math.log10(negligible)), 300)
    return np.full(x.size, round(float(np.median(x)), decimals) + 0.0)


# Samples by status: their numbers, those that failed, and whether enough are ok for a verdict.

FAILURES_LISTED = 20
NOT_ASSEMBLABLE = "not_assemblable"

STATUSES = {
    OK: "ran to its end; its numbers are used",
    "not_at_rest": "still moving at its horizon; the message says what moves",
    "not_converged": "the solver failed: a step missed its tolerance, or no forces were found that balance the loads",
    "jammed": "a time step has no solution: a motion drives a body into one that cannot give way",
    "diverged": "a number became infinite or undefined",
    "timeout": "ran longer than its time limit",
    "invalid": "ran to its end, but broke a validity condition or missed an event",
    NOT_ASSEMBLABLE: "the parts overlap as drawn, and no start pose nearby is free; the message says why",
    "crashed": "the process ended or the code raised an error",
}


@dataclass(frozen=True)
class StatusCount:
    """Number of samples with a status, and the first of them as an example."""

    status: str
    meaning: str
    count: int
    share: float | None
    example: int | None
    message: str


@dataclass(frozen=True)
class FailedSample:
    """A failed sample, and the command that repeats it."""

    sample: int
    status: str
    message: str
    command: str


def count_statuses(samples: Samples) -> tuple[StatusCount, ...]:
    """Count the samples of every known status, even if there are none, and of every other status in the rows."""
    counts = []
    for status in [*STATUSES, *sorted(set(samples.statuses) - set(STATUSES))]:
        rows, meaning = samples.having(status), STATUSES.get(status, "a status this version does not know")
        count = int(np.count_nonzero(rows))
        share = count / samples.sample.size if samples.sample.size else None
        example = int(samples.sample[np.argmax(rows)]) if status != OK and count > 0 else None
        message = "" if example is None else samples.messages.get(example, "")
        counts.append(StatusCount(status, meaning, count, share, example, message))
    return tuple(counts)


def list_failures(spec: ReportSpec, samples: Samples) -> tuple[FailedSample, ...]:
    """List the first failed samples, each with the command that repeats it with the same inputs."""
    return tuple(
        FailedSample(
            sample=int(samples.sample[row]),
            status=samples.statuses[samples.status[row]],
            message=samples.messages.get(int(samples.sample[row]), ""),
            command=spec.command({v.name: samples.values[v.name][row] for v in spec.variables}),
        )
        for row in np.flatnonzero(~samples.ok)[:FAILURES_LISTED]
    )


def counts_by_status(samples: Samples) -> dict[str, int]:
    """Return the number of samples with each status that occurs."""
    return {status: int(np.count_nonzero(samples.having(status))) for status in samples.statuses}


def judged_counts(counts: Mapping[str, int], limit: float | None) -> dict[str, int]:
    """Return the numbers of samples by status, without those that a limit of their own judges."""
    return {status: count for status, count in counts.items() if limit is None or status != NOT_ASSEMBLABLE}


def too_few_ok(ok: int, finished: int, least: float) -> bool:
    """Return whether fewer than the share `least` of the finished samples are ok; False without samples."""
    return finished > 0 and ok / finished < least


def failures_in_words(counts: Mapping[str, int]) -> str:
    """Return the failures, as in "12 of 20 samples failed (60 %: 10 not_converged, 2 timeout)"."""
    finished, failed = sum(counts.values()), sum(counts.values()) - counts.get(OK, 0)
    share = short_percent(failed / finished)
    return f"{grouped(failed)} of {grouped(finished)} samples failed ({share}: {statuses_in_words(counts)})"


def statuses_in_words(counts: Mapping[str, int]) -> str:
    """Return the statuses of failed samples, the most frequent first, such as "10 not_converged, 2 timeout"."""
    failed = sorted((-count, status) for status, count in counts.items() if status != OK and count)
    return ", ".join(f"{grouped(-count)} {status}" for count, status in failed)


def why_no_property(name: str, samples: Samples, least: float) -> str:
    """Return why a response has no verdict: more than 1 - `least` of its values are forces at impacts; else empty."""
    ok = int(np.count_nonzero(samples.ok))
    struck = int(np.count_nonzero(samples.at_impact[name] & samples.ok)) if name in samples.at_impact else 0
    if struck <= (1 - least) * ok:
        return ""
    return (
        f"{grouped(struck)} of {grouped(ok)} values are forces in the step of an impact: its impulse divided by the "
        "length of the step, and no property of the mechanism. Measure the impulse (contact_impulse) or a mean over a "
        "time (averaged_over), or drive so slowly that nothing strikes."
    )


def why_no_verdict(counts: Mapping[str, int], least: float) -> str:
    """Return why a campaign with less than the share `least` of ok samples has no verdict; empty if it may have one."""
    if not too_few_ok(counts.get(OK, 0), sum(counts.values()), least):
        return ""
    enough = short_percent(least)
    return f"{failures_in_words(counts)} and may be the rejects. A verdict needs at least {enough} ok samples."


def why_no_value(samples: Samples, values: int, least: float) -> str:
    """Return why a response has no verdict: too few samples have one, and the others may be rejects; else empty."""
    finished = samples.sample.size
    if not too_few_ok(values, finished, least):
        return ""
    missing = f"{grouped(finished - values)} of {grouped(finished)} samples have no value"
    return f"{missing} and may be the rejects. A verdict needs at least {short_percent(least)} with one."
