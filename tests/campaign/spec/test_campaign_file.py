"""Tables of a campaign file about failures and settings."""

import pytest

from campaign.errors import SpecError
from campaign.spec.campaign_file import Failures, SimulationSettings
from campaign.spec.load import load_campaign


@pytest.mark.parametrize(
    ("most", "samples", "allowed"), [(5, 1000, 5), (0.01, 1000, 10), (None, 1000, float("inf")), (0, 5, 0)]
)
def test_most_failed_is_a_number_or_a_share(most, samples, allowed):
    """Below one a share of all samples."""
    assert Failures(max_failed=most).most_failed(samples) == allowed


def test_settings_in_words():
    """As a row keeps them."""
    assert SimulationSettings(step=0.002, tolerance=1e-7).text() == "step 0.002, tolerance 1e-07"
    assert SimulationSettings().text() == "settings of the mechanism"


BAD = {
    "unknown key of a retry": ("[failures]\nretry = [{ stp = 1e-3 }]", "failures.retry.0.stp"),
    "too many failures": ("[failures]\nmax_failed = 1.5", "failures.max_failed"),
    "share of good runs": ("[failures]\nmin_ok = 2", "failures.min_ok = 2"),
    "no time": ("[execution]\ntime_limit = 0", "execution.time_limit = 0"),
    "no memory": ("[execution]\nmemory_limit = 0.1", "execution.memory_limit = 0.1"),
    "unknown table": ("[retry]\nstep = 1", "retry: unknown key"),
}


@pytest.mark.parametrize(("table", "said"), BAD.values(), ids=BAD)
def test_bad_policy_is_refused(campaign_file, table, said):
    """With the key."""
    campaign_file.write_text(f"{campaign_file.read_text()}\n{table}\n")
    with pytest.raises(SpecError) as caught:
        load_campaign(str(campaign_file))
    assert said in str(caught.value)
