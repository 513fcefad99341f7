"""What must hold of a store when a campaign is over, whatever happened to it."""

from campaign.store import layout
from campaign.store.files.files import TEMPORARY
from campaign.store.survey import load_manifest

VARIES = ["wall_s", "attempts"]


def bits(store, plan):
    """Return the table without what may differ between two computations."""
    return store.table(plan.campaign_id).drop_columns(VARIES)


def check_whole(store, plan, reference):
    """Check that the store has every row once, with the bits of the fault-free table, and nothing else."""
    table = bits(store, plan)
    assert table["sample"].to_pylist() == list(range(plan.spec.samples))
    assert table.equals(reference)
    survey = store.survey(plan, verify=True)
    assert (survey.missing, survey.bad, survey.rows) == ([], {}, plan.spec.samples)
    known = load_manifest(store.files, plan)
    assert {part.batch: part for parts in known.values() for part in parts} == survey.parts
    root = plan.campaign_id
    names = set(store.files.names(root)) - {"reports"}
    kept = {"plan.json", "campaign.toml", "state.json", "heartbeat.json", "parts", layout.MANIFEST}
    assert names == kept, names ^ kept  # no lease, no marker, nothing temporary
    assert [name for name in store.files.names(f"{root}/parts") if name.endswith(TEMPORARY)] == []
    assert store.read_json(root, "state.json")["state"] == "completed"
