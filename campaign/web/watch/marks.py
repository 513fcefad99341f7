"""What changes whenever the files of a campaign change."""

from hashlib import sha256

from campaign.store import Store
from campaign.store.layout import MANIFEST, PARTS, REPORT, STATE


def campaign_marks(store: Store) -> dict[str, str]:
    """Return campaign -> a mark of its files."""
    return {campaign: _mark(store, campaign) for campaign in store.campaigns()}


def _mark(store: Store, campaign: str) -> str:
    folders = {name: store.files.sizes(f"{campaign}/{name}") for name in ("", PARTS, REPORT)}
    state = store.read_json(campaign, STATE), store.read_json(campaign, MANIFEST) is not None
    return sha256(repr((folders, state)).encode()).hexdigest()[:16]
