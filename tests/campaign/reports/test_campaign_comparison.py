"""Two campaigns as data: what the report against the other says."""

import json
from pathlib import Path

import pytest

from campaign.errors import CampaignError
from campaign.json_values import json_values
from campaign.reports.campaign_comparison import comparison_document
from campaign.reports.report import report
from campaign.spec.load import load_campaign
from tests.campaign.driving import computed


def both(campaign_file, folder, change):
    """Return a store with a campaign and one whose file has another text, and their plans."""
    store, first = computed(folder, load_campaign(str(campaign_file), samples=200), 100)
    other = campaign_file.parent / "other.toml"
    other.write_text(change(campaign_file.read_text()))
    _, second = computed(folder, load_campaign(str(other), samples=200), 100)
    return store, first, second


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("mean = 0.07", "mean = 0.08"),
        lambda text: text.replace("std = 0.0175", "std = 0.0175\nbatch = {size = 20, std = 0.01}"),
    ],
)
def test_the_numbers_are_those_of_the_report(campaign_file, tmp_path, change):
    """Of a shifted mean, and of a campaign with production batches against one without."""
    store, first, second = both(campaign_file, tmp_path / "runs", change)
    found = comparison_document(store, first, second)
    written = report(store, first, kinds=("json",), against=second.campaign_id)
    expected = json.loads(Path(written["json"]).read_text(encoding="utf-8"))["comparison"]
    compared = json.loads(json.dumps(json_values(found["comparison"])))
    assert found["campaign"] == first.campaign_id
    assert compared["campaign"] == second.campaign_id
    for mine, said in zip(compared["responses"], expected["responses"], strict=True):
        for key in ("response", "mean_difference", "mean_interval", "std_ratio", "cpk_difference", "histogram"):
            assert mine[key] == said[key]
    assert compared["responses"][0]["mean_difference"] is not None


def test_corners_are_not_compared(campaign_file, tmp_path):
    """They do not represent production."""
    store, first = computed(tmp_path / "runs", load_campaign(str(campaign_file), samples=200), 100)
    other = campaign_file.parent / "other.toml"
    other.write_text(campaign_file.read_text().replace("seed = 7", 'seed = 7\nsampler = "worst_case"'))
    _, second = computed(tmp_path / "runs", load_campaign(str(other), samples=5), 100)
    with pytest.raises(CampaignError, match="are corners"):
        comparison_document(store, first, second)
