"""When too many samples failed for a verdict, and how failures are counted in words."""

import pytest

from reporting.samples import failures_in_words, too_few_ok, why_no_verdict


@pytest.mark.parametrize(
    ("ok", "finished", "least", "too_few"),
    [(99, 100, 0.99, False), (98, 100, 0.99, True), (3, 30, 0.1, False), (0, 0, 0.99, False), (19, 20, 1.0, True)],
)
def test_a_share_of_ok_samples_is_exact(ok: int, finished: int, least: float, too_few: bool) -> None:
    """3 of 30 are a tenth, although 0.1 * 30 is above 3 in doubles; no sample at all has not failed."""
    assert too_few_ok(ok, finished, least) is too_few


def test_failures_name_their_statuses_the_most_frequent_first() -> None:
    counts = {"ok": 8, "timeout": 2, "not_converged": 10, "crashed": 0}
    assert failures_in_words(counts) == "12 of 20 samples failed (60\u00a0%: 10 not_converged, 2 timeout)"
    assert "A verdict needs at least 99\u00a0% ok samples." in why_no_verdict(counts, 0.99)
    assert why_no_verdict(counts, 0.4) == ""
