"""The trust card, part one: did the simulation do what it promises, sample by sample.

Levels: "good", "attention" (read on before you sign), "bad" (do not sign), "info" (nothing to judge by).
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from reporting.render import format_numbers as numbers
from reporting.samples import OK, Samples

if TYPE_CHECKING:
    from reporting.response import ResponseAnalysis

# What the project promises of every ok row: relative residual of the friction problem, gap violation by unit.
RESIDUAL_BAR = 1e-6
PENETRATION_BAR = {"mm": 1e-6, "m": 1e-9}
OK_SHARE_BAR = 0.99


@dataclass(frozen=True)
class Check:
    """One line of the trust card: what was checked, the level, a sentence, and its number if it has one."""

    name: str
    level: str
    text: str
    value: float | None = None


def complete(requested: int, samples: Samples) -> Check:
    """Check that every sample asked for is there."""
    done = samples.sample.size
    text = f"{numbers.grouped(done)} of {numbers.grouped(requested)} samples asked for are done."
    if done < requested:
        text += " The campaign is not finished: every number below is provisional."
    return Check("Complete", "good" if done == requested else "attention", text, float(done))


def failed(samples: Samples) -> Check:
    """Check that few samples failed, and say how the most frequent failure reads."""
    done, ok = samples.sample.size, int(np.count_nonzero(samples.ok))
    if done == 0:
        return Check("Failures", "bad", "No sample is done yet.")
    if ok == done:
        return Check("Failures", "good", "No sample failed.", 0.0)
    counts = {word: samples.rows_of(word).size for word in sorted(samples.statuses) if word != OK}
    worst = max(counts, key=counts.__getitem__)
    row = int(samples.rows_of(worst)[0])
    said = samples.messages.get(int(samples.sample[row]), "").strip() or "no message"
    text = (
        f"{numbers.grouped(done - ok)} of {numbers.grouped(done)} samples failed "
        f"({numbers.percent((done - ok) / done)}) and are in no statistic; most often {worst}, "
        f"first in sample {samples.sample[row]}: {said}"
    )
    level = "bad" if ok == 0 else "good" if ok / done >= OK_SHARE_BAR else "attention"
    return Check("Failures", level, text, float(done - ok))


def largest(name: str, samples: Samples, values: NDArray[np.float64], unit: str, bar: float | None) -> Check:
    """Check the largest of a certificate's numbers over the ok samples against its bar."""
    rows = np.flatnonzero(samples.ok)
    known = rows[np.isfinite(values[rows])]
    if known.size == 0:
        return Check(name, "info", f"No {OK} sample states it.")
    row = int(known[np.argmax(values[known])])
    most, suffix = float(values[row]), f" {unit}" if unit else ""
    said = f"{numbers.significant(most, 2)}{suffix}, sample {samples.sample[row]}"
    text = f"Largest over the ok samples: {said}"
    if known.size < rows.size:
        return Check(name, "bad", f"{text}; {rows.size - known.size} ok samples state none.", most)
    if bar is None:
        return Check(name, "info", f"{text}.", most)
    level = "good" if most <= bar else "bad"
    text += f"; {'within' if level == 'good' else 'over'} the bar of {numbers.plain(bar)}{suffix}."
    return Check(name, level, text, most)


def settled(samples: Samples) -> Check:
    """Check that every ok sample came to rest."""
    total = int(np.count_nonzero(samples.ok))
    moving = total - int(np.count_nonzero(samples.settled & samples.ok))
    if total == 0:
        return Check("Settled", "info", "No ok sample.")
    if moving == 0:
        return Check("Settled", "good", "Every ok sample came to rest before its end.", 0.0)
    text = f"{numbers.grouped(moving)} ok samples ({numbers.percent(moving / total)}) were still moving when read."
    return Check("Settled", "attention", text, float(moving))


def missing(responses: "tuple[ResponseAnalysis, ...]") -> Check:
    """Check that every ok sample has a number for every response."""
    holes = [(r.spec.name, r.missing) for r in responses if r.missing]
    if not holes:
        return Check("Values", "good", "Every ok sample has a finite number for every response.", 0.0)
    listed = ", ".join(f"{name} {numbers.grouped(count)}" for name, count in holes)
    text = f"Ok samples without a finite number, left out of the statistics and counted as rejects: {listed}."
    return Check("Values", "bad", text, float(sum(count for _, count in holes)))
