"""What must hold of a server after a storm, and of what it has told those who use it."""

from itertools import pairwise

from clearcap.web.access.audit import AuditTrail
from clearcap.web.access.database import Database
from tests.campaign.storms.disturbances import LOSSES
from tests.campaign.storms.server import DATABASE

ACTIONS = {  # of the audit trail, by the kind of an entry
    "add_user": "POST /api/v1/users",
    "share": "POST /api/v1/campaigns/{campaign}/shares",
    "sign": "POST /api/v1/campaigns/{campaign}/signoffs",
}


def check_visits(storm, batch):
    """Check what those who use a server have seen and made, while it still answers.

    Parameters
    ----------
    storm : Storm
        That is over.
    batch : int
        Largest number of rows in a part: so many may be lost again when one is damaged.
    """
    visitors = storm.visitors
    assert not visitors.faults, visitors.faults[:3]
    assert 500 not in visitors.statuses, visitors.statuses
    assert visitors.has_seen_the_end
    last = visitors.events[-1]
    assert (last["state"], last["left"]) == ("completed", 0), last
    counts = [event["done"] for event in visitors.events if event["done"] is not None]
    falls = [before - after for before, after in pairwise(counts) if after < before]
    lost = sum(number for kind, number, _ in storm.hits if kind in LOSSES)
    assert sum(falls) <= batch * lost, counts
    assert {kind for kind, _ in visitors.kept} == set(ACTIONS), "nobody had time to make anything"
    assert set(visitors.kept) <= visitors.entries()
    for path in (f"/campaigns/{storm.campaign}", "/campaigns"):
        page = visitors.ask("GET", path, headers={"Accept": "text/html"})
        assert page is not None, "no page"
        assert page.status_code == 200, page.text
        assert storm.campaign in page.text


def check_accounts(storm):
    """Check the accounts of a server that has ended: the file is whole, and so is the audit trail, with each entry."""
    database = Database(storm.accounts / DATABASE)
    try:
        assert [row[0] for row in database.rows("PRAGMA integrity_check")] == ["ok"]
        assert database.rows("PRAGMA foreign_key_check") == []
        trail = AuditTrail(database)
        assert trail.first_fault() is None
        made = [entry.action for entry in trail.newest(count=10**6) if entry.status == 201]
    finally:
        database.close()
    for kind, action in ACTIONS.items():
        kept = sum(each == kind for each, _ in storm.visitors.kept)
        assert made.count(action) >= kept, (kind, kept)
