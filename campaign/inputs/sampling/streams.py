"""Random words of 64 bits by number: any word of any stream is available directly, in any order.

The generator is counter-based (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011): word ``i`` of a
Philox stream, keyed by the campaign's seed and a variable's name, belongs to sample ``i``. So more samples keep the
first ones, and an additional variable does not change the others.
"""

import hashlib
import threading
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Array

Words = NDArray[np.uint64]

WORDS_PER_BLOCK = 4  # Philox4x64 yields four words for each value of its counter
# purposes of streams
VALUE, BATCH, SCRAMBLE, STRATA, PLACE = "", "batch\n", "scramble\n", "strata\n", "place\n"
COMPONENT = "component\n"


class _Generator(threading.local):
    """One generator per thread, set to another stream at each call, because a new one takes seven times as long."""

    def __init__(self) -> None:
        self.philox = np.random.Philox(key=0)

    def words(self, key: Words, block: int, count: int) -> Words:
        empty = np.zeros(WORDS_PER_BLOCK, dtype=np.uint64)
        counter = np.array([block, 0, 0, 0], dtype=np.uint64)
        self.philox.state = {
            "bit_generator": "Philox",
            "state": {"counter": counter, "key": key},
            "buffer": empty,
            "buffer_pos": WORDS_PER_BLOCK,
            "has_uint32": 0,
            "uinteger": 0,
        }
        return self.philox.random_raw(count)


_generator = _Generator()


def words(seed: int, name: str, first: int, count: int, purpose: str = VALUE) -> Words:
    """Return ``count`` random words of a stream, starting at word ``first``, shape (count,)."""
    block, skipped = divmod(first, WORDS_PER_BLOCK)
    return _generator.words(_key(seed, name, purpose), block, skipped + count)[skipped:]


def uniforms(seed: int, name: str, first: int, count: int, purpose: str = VALUE) -> Array:
    """Return uniform numbers strictly inside (0, 1), shape (count,)."""
    # 52 bits, centred in their cells: neither 0 nor 1 can occur, and 1 - u is exact.
    return ((words(seed, name, first, count, purpose) >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def permutation(seed: int, name: str, size: int, first: int = 0, purpose: str = VALUE) -> NDArray[np.int64]:
    """Return a random permutation of 0 .. size - 1 from the words ``first`` to ``first + size - 1`` of a stream."""
    # stable: how other sorts order equal words is up to the library
    return np.argsort(words(seed, name, first, size, purpose), kind="stable")


@lru_cache(maxsize=4096)
def _key(seed: int, name: str, purpose: str) -> Words:
    """Return 128 bits that differ for every triple of purpose, seed and name, shape (2,)."""
    # the order of bytes is fixed, so that the key is the same on every machine
    return np.frombuffer(hashlib.sha256(f"{purpose}{seed}\n{name}".encode()).digest()[:16], dtype="<u8").astype(
        np.uint64
    )
