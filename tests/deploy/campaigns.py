"""A small campaign of a stand-in for the physics, planned in a store of its own."""

from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinate import coordinate
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store
from engine import jit, warm_up
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC


def planned(folder, name):
    """Plan 60 samples in a store in a folder, or at a URL; return store and plan."""
    path = folder / "demo.toml"
    path.write_text(SPEC)
    store = open_store(name if "://" in name else str(folder / name))
    return store, store.create_plan(make_plan(load_campaign(str(path), samples=60), 4))


def computed_here(folder):
    """Return the rows that a worker of this machine computes."""
    store, plan = planned(folder, "here")
    coordinate(store, plan, Cluster(workers=1), simulate=fake_engine.simulate)
    return rows(store, plan)


def rows(store, plan):
    """Return what must not depend on where a campaign is computed."""
    return store.table(plan.campaign_id).drop_columns(["wall_s", "attempts"])


def compiled_on_nodes(folder):
    """Have nodes whose local disk is a folder find there what the engine has compiled: it takes minutes."""
    warm_up()
    node = folder / "clearcap.test"
    node.mkdir(mode=0o700)
    (node / "compiled").symlink_to(jit.CACHE_FOLDER.parent)
