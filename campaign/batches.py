"""The batches of a campaign: successive samples, which one task computes; they follow from their size, however many."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

Span = tuple[int, int]  # first sample and number of samples


@dataclass(frozen=True)
class Batches(Sequence[Span]):
    """The batches of ``samples`` samples, by number: each has ``size`` of them, the last one what is left.

    It takes no more memory for many batches than for few, and every look-up takes the same time.
    """

    samples: int
    size: int

    def __post_init__(self) -> None:
        if not 1 <= self.size <= self.samples < 2**63:
            raise ValueError(f"its batches have {self.size} samples each; allowed: 1 to all its {self.samples} samples")

    def __len__(self) -> int:
        return len(self._firsts)

    @overload
    def __getitem__(self, number: int) -> Span: ...
    @overload
    def __getitem__(self, number: slice) -> tuple[Span, ...]: ...
    def __getitem__(self, number: int | slice) -> Span | tuple[Span, ...]:
        if isinstance(number, slice):
            return tuple(map(self._from, self._firsts[number]))
        return self._from(self._firsts[number])

    def __iter__(self) -> Iterator[Span]:
        return map(self._from, self._firsts)

    def batch_of(self, sample: int) -> int:
        """Return the number of the batch that holds a sample."""
        return sample // self.size

    @property
    def _firsts(self) -> range:
        return range(0, self.samples, self.size)

    def _from(self, first: int) -> Span:
        return first, min(self.size, self.samples - first)


def as_rule(batches: tuple[Span, ...]) -> "Batches | tuple[Span, ...]":
    """Return listed batches by their size if they have one, as they are if not."""
    rule = Batches(sum(batches[-1]), batches[0][1])
    return rule if tuple(rule) == batches else batches
