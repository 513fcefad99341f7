"""What the service has the engine do: check what was posted, simulate one run, repeat a sample, write a report.

All take plain data and give plain data, so that they run in the processes of a pool. What strangers posted is never a
path: texts and the files that they name come with the call.
"""

import tempfile
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from campaign.errors import SpecError
from campaign.reports.report import report
from campaign.spec.load import load_campaign_text
from campaign.store import open_store
from campaign.store.files.patience import QUICK
from engine import Mechanism, Recording, library_names, load_mechanism, load_mechanism_text, set_values, simulate
from engine import check as check_start
from engine.preflight import cautions
from reporting.write import USUAL

RECORDED_STEPS = 10  # of which one is in the motion of a single run


@dataclass(frozen=True)
class SingleRun:
    """What a single run is asked for.

    Attributes
    ----------
    mechanism : str
        Name of a shipped mechanism, or the text of a mechanism file if `is_text`.
    is_text : bool
    values : mapping of str to float
        Numbers to change, such as ``{"J1": 0.05}``.
    bench, preset : str or None
        One of the mechanism's test benches, and of its named sets of values.
    motion : bool
        Whether the motion is asked for instead of the numbers.
    """

    mechanism: str
    is_text: bool = False
    values: Mapping[str, float] = field(default_factory=dict)
    bench: str | None = None
    preset: str | None = None
    motion: bool = False


def check_mechanism(text: str) -> dict[str, Any]:
    """Return ``{"mechanism", "digest", "warnings"}`` of the text of a mechanism file; SpecError with its faults."""
    loaded = load_mechanism_text(text)
    check_start(loaded)
    warnings = [caution.to_json() for caution in cautions(loaded)]
    return {"mechanism": loaded.name, "digest": loaded.digest(), "warnings": warnings}


def check_campaign(text: str, files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return ``{"name", "title", "samples", "variables", "responses"}`` of a campaign; SpecError with its faults.

    Parameters
    ----------
    text : str
        Content of the campaign file.
    files : mapping of str to bytes
        Content of the files that it names.
    """
    spec = load_campaign_text(text, files).spec
    names = {"variables": list(spec.variables), "responses": list(spec.responses)}
    return {"name": spec.name, "title": spec.title or spec.name, "samples": spec.samples, **names}


def single_run(asked: SingleRun) -> dict[str, Any] | bytes:
    """Return the document of ``clearcap simulate --json``; with ``motion`` the bytes of its HDF5 file.

    Raises
    ------
    SpecError
        If the mechanism or a value is wrong.
    """
    loaded = _mechanism(asked)
    if asked.motion:
        with tempfile.TemporaryDirectory(prefix="clearcap-motion-") as folder:
            path = Path(folder, "motion.h5")
            simulate(loaded, trajectory=Recording(path, RECORDED_STEPS))
            return path.read_bytes()
    run = simulate(loaded, indeterminacy=True)
    results = {"status": run.status, "message": run.message, "responses": run.measured, "units": run.units}
    warnings = [] if run.status == "ok" else [caution.to_json() for caution in cautions(loaded)]
    return {**results, "ranges": run.ranges, "certificate": asdict(run.certificate), "warnings": warnings}


def written_report(
    store: str, campaign: str, against: str | None = None, kinds: Collection[str] = USUAL
) -> dict[str, str]:
    """Write the report of a campaign, or its comparison with another; return the path or URL of each file by kind."""
    opened = open_store(store, QUICK)
    return report(opened, opened.plan(campaign), kinds=kinds, against=against)


def _mechanism(asked: SingleRun) -> Mechanism:
    """Return the mechanism of a run with its values set."""
    if asked.is_text:
        loaded = load_mechanism_text(asked.mechanism)
    elif asked.mechanism in library_names():
        loaded = load_mechanism(asked.mechanism)
    else:
        raise SpecError(f"mechanism {asked.mechanism:.60}: is not shipped; allowed: {', '.join(library_names())}")
    values = {**(loaded.preset(asked.preset) if asked.preset else {}), **asked.values}
    loaded = loaded.on_bench(asked.bench) if asked.bench else loaded
    return set_values(loaded, values) if values else loaded
