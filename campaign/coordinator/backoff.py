"""Increasing pauses between attempts at an operation that fails."""

import time

TRIES = 10  # attempts in a row at a batch
PAUSES = (0.5, 15.0)  # s; the first and the longest pause; each is twice as long as the one before


class Backoff:
    """Count successive failures and wait after each."""

    def __init__(self) -> None:
        self.failures = 0

    def fail(self) -> None:
        """Count a failure."""
        self.failures += 1

    def wait(self) -> None:
        """Wait for the pause that the number of failures determines."""
        first, longest = PAUSES
        # 20 doublings are far beyond the longest pause; an unlimited power would overflow in the end
        time.sleep(min(first * 2.0 ** min(self.failures - 1, 20), longest))

    def reset(self) -> None:
        """Forget the failures after a success."""
        self.failures = 0
