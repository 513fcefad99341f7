"""Names of the files and folders of a store, each defined only here.

``STORE/CAMPAIGN_ID/`` holds the definition of a campaign (its plan), its results so far (its parts and those of its
repeats), the state of its computation (state, lease, heartbeat, cancel marker), and its report.
"""

import re

from campaign.plan_header import PARTS, PlanHeader

PLAN = "plan.json"
DELETED = "plan.json.deleted"  # the plan of a campaign whose deletion has begun
CAMPAIGN_FILE = "campaign.toml"
SUBMISSION = "submission.json"  # who submitted it, and when
MANIFEST = "manifest"  # how its files begin
REPEATS = "repeats.json"  # exists once somebody has asked for more repeats than the plan has
STOPPED = "stopped.json"  # exists once the stopping rule has ended the campaign
DECISION = "decision.json"  # names the aimed campaigns that decide what this one leaves open
STATE = "state.json"
LEASE = "lease.json"
HEARTBEAT = "heartbeat.json"
RERUN = "rerun.json"  # a request: the coordinator that serves the store computes failed rows again
SIGNED = "signed.json"  # exists while a sign-off holds: plan, rows and report stay as they were signed
CANCEL = "cancel"  # a marker: coordinator and workers that find it stop computing the campaign
REPORT = "report"
COMPARISONS = "comparisons"  # holds a folder for each campaign that this one was compared with
POOLED = "pooled"  # holds a folder for each set of campaigns that are one report with this one
LOG = "coordinator.log"

SERVICE = "service"  # beside the campaigns: the lease and the heartbeat of a coordinator that serves the store


def manifest_name(plan: PlanHeader, segment: int = 0) -> str:
    """Return the name of a segment of the manifest of a campaign's rows, or of a set of its repeats, in the store."""
    name = MANIFEST if plan.folder == PARTS else plan.folder
    return f"{plan.campaign_id}/{name}{f'-{segment:06d}' if segment else ''}.json"


def is_of_manifest(name: str) -> bool:
    """Return whether a file in the folder of a campaign is of the manifest of its rows."""
    return re.fullmatch(rf"{MANIFEST}(-\d{{6}})?\.json", name) is not None


def labels_name(version: int) -> str:
    """Return the name of a version of a campaign's labels, relative to its folder."""
    return f"labels-{version:06d}.json"
