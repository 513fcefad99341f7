"""What a server in a storm finds when it starts: an admin who is logged in, and a campaign that can be signed."""

import time

from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from clearcap.questions.report import report
from clearcap.web.access import Role
from clearcap.web.access.database import Database
from clearcap.web.access.users import Sessions, Users
from clearcap.web.http.authentication import COOKIE, CSRF_HEADER
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed

DATABASE = "service.sqlite"


def new_session(data):
    """Add an admin to the accounts of a server that is still to start; return headers of a browser he is logged in by.

    A token would not do: none makes users. The session lasts even if the server's clock jumps ahead by weeks, which
    would log a user out.
    """
    database = Database(data / DATABASE)
    try:
        Users(database).add("admin", Role.ADMIN)
        secret, later = Sessions(database).begin("admin"), time.time() + 366 * 86400.0
        database.change("UPDATE sessions SET seen = ?, created = ? WHERE user = ?", later, later, "admin")
        return {"Cookie": f"{COOKIE}={secret}", CSRF_HEADER: Sessions(database).principal(secret).csrf}
    finally:
        database.close()


def signable_campaign(store, folder):
    """Compute a small campaign with a report, which nothing disturbs; return its id."""
    file = folder / "earlier.toml"
    file.write_text(SPEC.replace('"demo"', '"earlier"').replace("seed = 7", "seed = 8"))
    _, plan = computed(store.url, load_campaign(str(file)), 10)
    write_state(store, plan.campaign_id, "completed")
    report(store, plan)  # only what is made from these rows again is signed
    return plan.campaign_id
