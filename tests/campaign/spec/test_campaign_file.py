"""Tables of a campaign file about failures and settings."""

import pytest
from pydantic import ValidationError

from campaign.errors import SpecError
from campaign.spec.campaign_file import CampaignSpec, Failures, Response, SimulationSettings
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


def test_unequal_deviations_are_signed_and_exact_in_decimals() -> None:
    """20 +0.2/-0.1, and 20 +0.3/+0.1, on the drawing."""
    assert Response(nominal=20.0, upper=0.2, lower=-0.1).limits() == (19.9, 20.2, 20.0)
    assert Response(nominal=20.0, upper=0.3, lower=0.1, target=20.2).limits() == (20.1, 20.3, 20.2)
    assert Response(nominal=20.0, upper=0.3, lower=0.1).limits() == (20.1, 20.3, None)


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"nominal": 20.0, "upper": 0.2}, "lower and upper"),
        ({"nominal": 20.0, "upper": -0.2, "lower": 0.1}, "lower below upper"),
        ({"upper": 0.2, "lower": -0.1}, "only valid together"),
        ({"nominal": 20.0, "upper": 0.2, "lower": -0.1, "tolerance": 0.2}, "the same on both sides"),
        ({"lsl": 0.22, "usl": 0.38, "target": 0.9}, "target = 0.9 lies outside"),
        ({"usl": 15.0, "boundary": "lower"}, "no lower limit"),
    ],
)
def test_limits_that_make_no_sense_are_refused(keys, word) -> None:
    with pytest.raises(ValidationError, match=word):
        Response(**keys)


def test_a_requirement_is_a_number_or_a_class_of_the_campaign() -> None:
    tables = {
        **{"format": 1, "name": "c", "mechanism": "c60", "samples": 10, "requirements": {"critical": 2.0}},
        "variables": {"J1": {"distribution": "normal", "mean": 0.0, "std": 1.0}},
        "responses": {"A": {"requirement": "critical"}, "B": {"requirement": 1.67}, "C": {"usl": 1.0}},
    }
    spec = CampaignSpec.model_validate(tables)
    assert [spec.requirement(name) for name in "ABCD"] == [2.0, 1.67, None, None]
    with pytest.raises(ValidationError, match="did you mean 'critical'"):
        CampaignSpec.model_validate({**tables, "responses": {"A": {"requirement": "critcal"}}})
