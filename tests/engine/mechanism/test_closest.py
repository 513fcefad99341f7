"""A word is suggested for a slip of the pen or a part of it, not because some letters are the same."""

from engine.mechanism.closest import closest, slip_count
from tests.each import each

MECHANISM = ["simulation", "materials", "bodies", "joints", "contacts", "springs", "dampers", "forces", "responses"]
CAMPAIGN = ["mechanism", "samples", "seed", "sampler", "simulation", "variables", "correlations", "responses"]


@each(
    ("word", "words", "meant"),
    [
        ("samples", MECHANISM, None),
        ("materials", CAMPAIGN, None),
        ("bodies", CAMPAIGN, None),
        ("sampels", CAMPAIGN, "samples"),
        ("reponses", MECHANISM, "responses"),
        ("joint", MECHANISM, "joints"),
        ("prelaod", ["stiffness", "preload"], "preload"),
        ("centre_of_mass", ["mass", "center_of_mass"], "center_of_mass"),
        ("clearance", ["rings", "radial_clearance"], "radial_clearance"),
        ("corr", CAMPAIGN, "correlations"),
        ("J2", ["J1"], None),
        ("FC1", ["FC-1", "FC-2"], "FC-1"),
        ("Samples", CAMPAIGN, "samples"),
        ("x", ["y"], None),
        ("", ["y"], None),
    ],
)
def test_what_is_meant(word, words, meant):
    """The words of which one was asked about."""
    assert closest(word, words) == meant


def test_slips():
    """Added, left out, replaced, exchanged; counted no further than three."""
    pairs = {("ab", "ab"): 0, ("ab", "ba"): 1, ("ab", "abc"): 1, ("abc", "axc"): 1, ("abcd", "badc"): 2}
    assert {pair: slip_count(*pair) for pair in pairs} == pairs
    assert slip_count("a" * 50, "b" * 50) > 3
    assert slip_count("a", "a" * 50) > 3
