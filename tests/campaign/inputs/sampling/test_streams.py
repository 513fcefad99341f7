"""Random words belong to sample, variable and seed alone."""

import threading

import numpy as np
import pytest

from campaign.inputs.sampling.inverse_transform import uniforms

pytestmark = pytest.mark.bits


def test_threads_do_not_mix():
    """Two threads that draw at the same time get what one gets alone."""
    alone, wrong = uniforms(1, "a", 0, 1000).tobytes(), []

    def many(name):
        for _ in range(300):
            if name == "a" and uniforms(1, name, 0, 1000).tobytes() != alone:
                wrong.append(name)
            uniforms(2, name, 5, 999)

    threads = [threading.Thread(target=many, args=(name,)) for name in "abab"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_seeds_and_names_give_unrelated_streams():
    """No two streams are correlated beyond chance (n = 20,000: 5 standard errors are 0.035)."""
    streams = [uniforms(seed, name, 0, 20_000) for seed in (0, 1, 2**63 - 1) for name in ("J1", "J2", "J10", "é")]
    correlation = np.corrcoef(streams) - np.eye(len(streams))
    assert np.abs(correlation).max() < 0.035


def test_strictly_inside_the_unit_interval():
    """The quantile of 0 or 1 may be infinite: neither is drawn, not even from extreme words."""
    u = uniforms(3, "x", 0, 200_000)
    assert 0.0 < u.min() < 1e-4
    assert 1.0 - 1e-4 < u.max() < 1.0
    assert ((np.uint64(2**64 - 1) >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52 < 1.0
