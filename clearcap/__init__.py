"""clearcap in Python: simulate one mechanism, run a campaign, read its results as tables.

>>> import clearcap
>>> run = clearcap.simulate(clearcap.load_mechanism("c60"), {"J1": 0.05})
>>> results = clearcap.run_campaign("c60", samples=100)
>>> results.rows["FC-1"].mean()

Each name is imported when it is first used, so that ``import clearcap`` takes no time.
"""

import os
import sys
from importlib import import_module

TYPE_CHECKING = False  # not from typing: ``python -m clearcap`` would look for it in the current folder

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster, Tls
    from campaign.coordinator.heartbeat import Heartbeat
    from campaign.errors import CampaignError, SpecError, StoreError, UnreachableError
    from campaign.spec.campaign_file import campaign_text
    from campaign.spec.load import Campaign, load_campaign, load_campaign_text
    from campaign.store import Store, open_store
    from clearcap.client.remote_server import RemoteServer, connect
    from clearcap.drawing import draw
    from clearcap.questions.calibration import calibrate_campaign
    from clearcap.questions.measured import capability_report, gauge_study, validate_campaign
    from clearcap.questions.monitoring import monitor_campaign
    from clearcap.results import PooledResults, Results, open_campaign, report, run_campaign
    from clearcap.submitted import RunningCampaign, submit_campaign
    from engine import (
        Certificate,
        EngineError,
        Fault,
        Mechanism,
        MechanismError,
        NotAssemblable,
        Recording,
        Run,
        TextPosition,
        Trajectory,
        library_names,
        load_mechanism,
        load_mechanism_text,
        position_of,
        read_trajectory,
        set_values,
        simulate,
    )
    from engine.mechanism.keys.values import SettableNumber, settable_numbers
    from engine.preflight import check
    from reporting import Capability, ReportError, capability

# fmt: off
__all__ = [
    "Campaign", "CampaignError", "Capability", "Certificate", "Cluster", "EngineError", "Fault", "Heartbeat",
    "Mechanism", "MechanismError", "NotAssemblable", "PooledResults", "Recording", "RemoteServer", "ReportError",
    "Results", "Run", "RunningCampaign", "SettableNumber", "SpecError", "Store", "StoreError", "TextPosition", "Tls",
    "Trajectory", "UnreachableError", "calibrate_campaign", "campaign_text", "capability", "capability_report", "check",
    "connect", "draw", "gauge_study", "library_names", "load_campaign", "load_campaign_text", "load_mechanism",
    "load_mechanism_text", "monitor_campaign", "open_campaign", "open_store", "position_of", "read_trajectory",
    "report", "run_campaign", "set_values", "settable_numbers", "simulate", "submit_campaign", "validate_campaign",
]
# fmt: on

# Where each name is imported from, if not from `engine`.
_HOMES = {
    "clearcap.client.remote_server": ("RemoteServer", "connect"),
    "clearcap.drawing": ("draw",),
    "campaign.cluster.cluster": ("Cluster", "Tls"),
    "campaign.coordinator.heartbeat": ("Heartbeat",),
    "campaign.errors": ("CampaignError", "SpecError", "StoreError", "UnreachableError"),
    "campaign.spec.campaign_file": ("campaign_text",),
    "campaign.spec.load": ("Campaign", "load_campaign", "load_campaign_text"),
    "campaign.store": ("Store", "open_store"),
    "clearcap.questions.calibration": ("calibrate_campaign",),
    "clearcap.questions.measured": ("capability_report", "gauge_study", "validate_campaign"),
    "clearcap.questions.monitoring": ("monitor_campaign",),
    "clearcap.results": ("PooledResults", "Results", "open_campaign", "report", "run_campaign"),
    "clearcap.submitted": ("RunningCampaign", "submit_campaign"),
    "engine.mechanism.keys.values": ("SettableNumber", "settable_numbers"),
    "engine.preflight": ("check",),
    "reporting": ("Capability", "ReportError", "capability"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import a name when it is first used."""
    if name == "__version__":
        from campaign.row_build import clearcap_version

        return clearcap_version()
    if name not in __all__:
        raise AttributeError(f"module 'clearcap' has no attribute {name!r}; it has {', '.join(__all__)}")
    try:
        globals()[name] = value = getattr(import_module(_HOME.get(name, "engine")), name)
    except (ImportError, AttributeError) as error:
        for package in ("campaign", "engine", "reporting"):
            found = getattr(sys.modules.get(package), "__file__", None)
            if found and _root(found) != _root(__file__):
                raise ImportError(f"{found}: hides clearcap's package {package}; rename this file or folder") from error
        raise
    return value


def _root(file: str) -> str:
    return os.path.dirname(os.path.dirname(os.path.realpath(file)))


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
