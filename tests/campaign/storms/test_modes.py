"""Which storms are run for a commit."""

from tests.campaign.storms.modes import MODES, SHARE, STORMS, chosen, mode_of


def test_each_commit_has_a_storm_with_a_server():
    """Six different ones of the hundred, the same for the same commit, and in all as many as there are."""
    seen = set()
    for number in range(300):
        seeds = chosen(f"commit {number}")
        assert seeds == chosen(f"commit {number}")
        assert len(set(seeds)) == SHARE
        assert any(MODES[mode_of(seed)].has_server for seed in seeds)
        seen |= set(seeds)
    assert seen == set(range(STORMS))
    assert {mode_of(seed) for seed in seen} == set(MODES)
