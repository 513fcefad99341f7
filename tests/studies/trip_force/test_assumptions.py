"""The grids of the study: what they change, and that they stay within what they say."""

from dataclasses import replace

import pytest

from studies.trip_force import MAPPED, PUBLISHED_BUMPS, SHIPPED, box, grids

pytestmark = pytest.mark.slow

GRIDS = grids()


def test_two_grids_leave_the_published_latch():
    """A grid of another latch is named for it, so that no fit hides among the published ones."""
    assert [name for name, sets in GRIDS.items() if not all(x.published for x in sets)] == [
        "angle of the latch's faces",
        "a deeper latch than any published",
    ]


def test_no_grid_has_a_set_twice():
    """Every set is counted once in its grid."""
    for name, sets in GRIDS.items():
        assert len(set(sets)) == len(sets) > 1, name


def test_the_mapped_grid_changes_the_latch_alone():
    """So its table has one column for the assumption; the shipped set is in it."""
    assert SHIPPED in GRIDS[MAPPED]
    assert all(replace(x, latch=SHIPPED.latch) == SHIPPED for x in GRIDS[MAPPED])


def test_the_box_is_filled_evenly():
    """Friction by its logarithm, the same sets again, and every public bump about equally often."""
    sets = list(box(64))
    assert sets == list(box(64))
    least = {"latch": 0.01} | dict.fromkeys(("bump", "bar", "pin", "flanges", "plastics", "steel"), 0.03)
    for name, mu in least.items():
        found = [getattr(x, name) for x in sets]
        assert mu <= min(found) < 1.1 * mu
        assert 9 * mu < max(found) <= 10 * mu
        assert sum(x < mu * 10**0.5 for x in found) == 32
    assert sum(x.bench == "trip_pin" for x in sets) == 32
    assert [sum(x.bump_radius == radius for x in sets) for radius in PUBLISHED_BUMPS] == [16] * 4


def test_what_differs_is_told():
    """A table names what was changed, and nothing else."""
    assert SHIPPED.changes() == "as shipped"
    assert replace(SHIPPED, latch=0.06, held=True).changes() == "latch 0.06, held across"
