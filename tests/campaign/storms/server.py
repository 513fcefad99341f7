"""What a server in a storm finds when it starts: an admin with a token, and a campaign that can be signed."""

from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from clearcap.web.access import Role
from clearcap.web.access.credentials import LONGEST_TOKEN, Tokens
from clearcap.web.access.database import Database
from clearcap.web.access.users import Users
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed

DATABASE = "service.sqlite"


def new_token(data):
    """Add an admin to the accounts of a server that is still to start; return headers with a token of his."""
    database = Database(data / DATABASE)
    try:
        Users(database).add("admin", Role.ADMIN)
        _, secret = Tokens(database).add("admin", "storm", Role.ADMIN, LONGEST_TOKEN)
    finally:
        database.close()
    return {"Authorization": f"Bearer {secret}"}


def signable_campaign(store, folder):
    """Compute a small campaign with a report, which nothing disturbs; return its id."""
    file = folder / "earlier.toml"
    file.write_text(SPEC.replace('"demo"', '"earlier"').replace("seed = 7", "seed = 8"))
    _, plan = computed(store.url, load_campaign(str(file)), 10)
    store.files.write(f"{plan.campaign_id}/report/report.html", b"<p>Cpk 1.33</p>")
    write_state(store, plan.campaign_id, "completed")
    return plan.campaign_id
