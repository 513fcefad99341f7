"""The progress of a campaign as one document: its state, its rows, its heartbeat and its comparisons."""

from collections.abc import Callable
from datetime import datetime
from typing import TYPE_CHECKING, Any

from campaign.coordinator.state import resume_command, state_of
from campaign.store import Store
from campaign.store.store import comparisons, repeat_plans, report_folder, survey_repeats

if TYPE_CHECKING:
    from campaign.coordinator.heartbeat import Heartbeat, Observation
    from campaign.plan_header import PlanHeader

COUNTS = ("samples", "done", "ok", "failed", "left", "statuses", "repeats", "repeated")
Say = Callable[[str], None]


def progress_report(store: Store, header: "PlanHeader", say: Say) -> dict[str, Any]:
    """Return the progress of a campaign as plain data, also of its running coordinator and of its comparisons."""
    campaign_id = header.campaign_id
    state, counts = progress(store, header, say)
    heartbeat = None
    if state["state"] == "running":
        # loads the engine's names, which an idle campaign does not need
        from campaign.coordinator.heartbeat import observe_patiently

        seen = observe_patiently(store, campaign_id)
        heartbeat, state["fault"] = seen.heartbeat, seen.odd
    return _report(store, campaign_id, {**state, **counts}, heartbeat, say)


def running_report(store: Store, seen: "Observation", say: Say) -> dict[str, Any] | None:
    """Return what `progress_report` does from an observation, without any file of rows; None unless it is running."""
    if seen.state != "running" or seen.heartbeat is None:
        return None
    counts = {name: getattr(seen.heartbeat, name) for name in COUNTS}
    state = {"state": seen.state, "message": seen.message, "since": seen.since, "open": seen.is_open, "fault": seen.odd}
    return _report(store, seen.campaign, {**_dated(state), **counts}, seen.heartbeat, say)


def _report(
    store: Store, campaign_id: str, progress: dict[str, Any], heartbeat: "Heartbeat | None", say: Say
) -> dict[str, Any]:
    compared = {
        other: store.files.address(report_folder(campaign_id, other)) for other in comparisons(store, campaign_id)
    }
    if progress["fault"]:
        say(f"{campaign_id}: {progress['fault']}")
    document = {"campaign": campaign_id, "store": store.url, **progress}
    waits_for = heartbeat.waits_for if heartbeat else ""
    beat = heartbeat and heartbeat.to_json()
    return {**document, "heartbeat": beat, "waits_for": waits_for, "comparisons": compared}


def progress(store: Store, header: "PlanHeader", say: Say) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the state of a campaign, ``incomplete`` if it lost rows after its end, and the numbers of its rows."""
    state, survey = state_of(store, header.campaign_id), store.survey(header)
    repeats = survey_repeats(store, repeat_plans(store, header))
    for reason in dict.fromkeys([*survey.bad.values(), *repeats.bad]):
        command = resume_command(store, header.campaign_id)
        say(f"{header.campaign_id}: {reason}; compute its samples again with: {command}")
    done, ok, failed = survey.rows, survey.statuses.get("ok", 0), header.failed(survey.statuses)
    samples = store.end(header)
    counts: dict[str, Any] = {"samples": samples, "done": done, "ok": ok, "failed": failed, "left": samples - done}
    counts |= {"statuses": survey.statuses, "repeats": repeats.planned, "repeated": repeats.done}
    if state["state"] == "completed" and counts["left"]:
        message = f"rows lost after the campaign was completed: {counts['left']}"
        state |= {"state": "incomplete", "message": message}
    return _dated(state), counts


def _dated(state: dict[str, Any]) -> dict[str, Any]:
    """Return a state with its date as ISO 8601, without the options of the command that computed it."""
    since = state["since"]
    date = None if since is None else datetime.fromtimestamp(since).astimezone().isoformat(timespec="seconds")
    return {**{key: value for key, value in state.items() if key != "options"}, "since": date}
