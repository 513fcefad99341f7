"""The positions of journals in their bearings at the ends of a campaign's first runs."""

from pathlib import Path
from tempfile import TemporaryDirectory

from campaign.cluster.process_workers import process_workers
from campaign.compiling import compile_engine
from campaign.inputs.sampling import draw
from campaign.spec.load import Campaign
from clearcap.pictures.play import JournalPositions, journal_positions, merge_runs
from engine import Mechanism, Recording, read_trajectory, simulate

ENDS = 10**9  # recording interval: only the first and the last row of a trajectory are kept


def campaign_journal_positions(campaign: Campaign, processes: int) -> list[JournalPositions]:
    """Simulate a campaign of few samples; return the journals' positions, by ring, at the ends of successful runs."""
    spec = campaign.spec
    drawn, targets = draw(spec, 0, spec.samples), spec.targets()
    values = [{targets[name]: float(x[i]) for name, x in drawn.items()} for i in range(spec.samples)]
    compile_engine()  # once, for all processes
    with process_workers(processes) as workers:
        fixed = (campaign.mechanism, spec.simulation.step, spec.simulation.horizon)
        runs = [workers.submit(f"sample-{i:06d}", _positions_at_end, *fixed, x) for i, x in enumerate(values)]
        while workers.next_finished() is not None:
            pass
        return merge_runs([positions for run in runs if (positions := run.result())])


def _positions_at_end(
    mechanism: Mechanism, step: float | None, horizon: float | None, values: dict[str, float]
) -> list[JournalPositions]:
    """Simulate once; return the positions of the journals at the end, empty if the run failed."""
    with TemporaryDirectory(prefix="clearcap-") as folder:
        path = Path(folder) / "end.h5"
        run = simulate(mechanism, values, step=step, horizon=horizon, trajectory=Recording(path, ENDS))
        return journal_positions(read_trajectory(path)) if run.status == "ok" else []
