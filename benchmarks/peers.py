"""clearcap beside other programs: rows of a campaign, the start, heaps of balls, three mechanisms.

The programs are installed from the package index into an environment of their own, `build/peers`, and run there
(`peer_rows.py`, `peer_motions.py`). A program that cannot be installed or fails has a row that says why. All times are
processor times, the shortest of some; all ratios are to clearcap in the same run.
"""

import json
import subprocess
import tempfile
import venv
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks import ROOT, heaps
from benchmarks.campaign import measure_overhead
from benchmarks.machine import command_s, processor_s
from engine.assembly import assemble
from engine.loop import control_of, drive
from tests.engine.friction.problems import natural_map_residual
from tests.engine.oracles.reference import at, recorded
from tests.engine.small import made, shipped

FOLDER = ROOT / "build/peers"
PYTHON = "bin/python"  # in the folder
PINS = {  # what each program is installed from, with the dependencies that change its speed
    "OpenTURNS": ("openturns==1.27.post1",),
    "joblib": ("joblib==1.6.0", "numpy==2.4.6"),
    "monaco": ("monaco==0.23.0", "scipy==1.17.1", "numpy==2.4.6"),
    "dask": ("dask==2026.8.0", "distributed==2026.8.0", "numpy==2.4.6"),
    "pyarrow": ("pyarrow==26.0.1", "numpy==2.4.6"),
    "MuJoCo": ("mujoco==4.0.0", "numpy==2.4.6"),
    "Exudyn": ("exudyn==1.13.6", "numpy==2.4.6"),
}
PIP = (
    "-m",
    "pip",
    "install",
    "-q",
    "--disable-pip-version-check",
    "--only-binary=:all:",
    "--retries=1",
    "--timeout=10",
)
LONGEST = 900.0  # s that an installation or a script may take
ROUNDS, REPEATS = 2, 3  # of rows and starts; of motions
ROWS = 100_000
COUNTED = {  # function of peer_rows.py: program, what it keeps on disk, rows
    "openturns": ("OpenTURNS", "one CSV at the end", ROWS),
    "bare_loop": ("pyarrow", "a Parquet of 500 rows each", ROWS),
    "joblib_one_process": ("joblib", "nothing", ROWS),
    "monaco": ("monaco", "nothing", ROWS // 10),
    "joblib_memory": ("joblib", "a file of each row", ROWS // 50),
    "dask": ("dask", "nothing", ROWS // 50),
}
MOTIONS: dict[str, tuple[float, int, tuple[float, ...], tuple[str, ...]]] = {
    # seconds between the instants that are compared, and their number; steps [s]; what is compared, in m or rad
    "clearance_pendulum": (0.01, 30, (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5), ("tip",)),
    "double_pendulum": (0.1, 20, (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4), ("upper", "lower")),
    "slider_crank": (0.004, 25, (4e-4, 2e-4, 1e-4, 4e-5, 2e-5, 1e-5), ("crank", "rod")),
}
FINER = 10  # the reference of a program is its own motion with the smallest step divided by this
INTEGRATORS = {  # of each program: with play, with ideal joints
    "MuJoCo": (("implicitfast", "RK4"), ("implicitfast", "RK4")),
    "Exudyn": (("ExplicitMidpoint", "VelocityVerlet"), ("GeneralizedAlpha", "TrapezoidalIndex2")),
}
BALLS = (30, 100)
Row = dict[str, Any]


class NotMeasured(Exception):
    """Why a program has no number."""


def measure() -> dict[str, list[Row]]:
    """Return the rows of each table."""
    points = [row for motion in MOTIONS for row in motion_rows(motion)]
    return {
        "rows": rows(),
        "starts": starts(),
        "heaps": heap_rows(),
        "motions": points,
        "equal": at_equal_error(points),
    }


@cache
def missing(program: str) -> str:
    """Install a program unless it is there; return why it cannot be, or nothing."""
    try:
        if not (FOLDER / PYTHON).exists():
            venv.create(FOLDER, with_pip=True)
        _run([*PIP, *PINS[program]])
    except (NotMeasured, OSError, subprocess.SubprocessError) as error:
        return f"not measured: pip cannot install {' '.join(PINS[program])} ({error}); see PIP_INDEX_URL"
    return ""


def ask(program: str, script: str, *words: str, **task: Any) -> Row:
    """Run a script in the environment of the programs and return its answer; raise NotMeasured."""
    if why := missing(program):
        raise NotMeasured(why)
    try:
        return dict(json.loads(_last(_run([Path(__file__).with_name(script), *words], json.dumps(task)))))
    except (NotMeasured, ValueError) as error:
        raise NotMeasured(f"not measured: {script} failed: {error}") from error


def _run(words: Sequence[str | Path], given: str = "") -> str:
    """Return what the Python of the programs prints; raise NotMeasured with its last error."""
    command = [FOLDER / PYTHON, "-I", *words]
    try:
        done = subprocess.run(
            command, input=given, cwd=FOLDER, timeout=LONGEST, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise NotMeasured(f"no end after {LONGEST:.0f} s") from error
    if done.returncode:
        raise NotMeasured(_last(done.stderr))
    return done.stdout


def _last(text: str) -> str:
    return next((line.strip() for line in reversed(text.splitlines()) if line.strip()), "no message")


def _or_why(row: Row, key: str, numbers: Callable[[], Row]) -> Row:
    """Return the row with its numbers, or with why there are none under the key."""
    try:
        return row | numbers()
    except NotMeasured as why:
        return row | {key: str(why)}


# -- rows that take no time, and the start -----------------------------------------------------------------------------


def rows() -> list[Row]:
    """Return the processor time of a row that takes no time, for each program."""
    whole = min((measure_overhead(500) for _ in range(ROUNDS)), key=lambda found: found["processor_us"])
    own = {f"a worker, {size} rows a part": min(own_row_us(ROWS, size) for _ in range(ROUNDS)) for size in (500, 50)}
    own["all processes, 500 rows a part"] = whole["processor_us"] * whole["workers"]
    unit = next(iter(own.values()))

    def counted(number: int, us: float) -> Row:
        return {"rows": number, "us a row": us, "to clearcap": us / unit}

    def asked(function: str, program: str, number: int) -> Row:
        seconds = min(ask(program, "peer_rows.py", function, str(number))["s"] for _ in range(ROUNDS))
        return counted(number, 1e6 * seconds / number)

    kept = "kept on disk"
    table = [
        {"program": f"clearcap, {how}", kept: "sealed rows, resumable"} | counted(ROWS, us) for how, us in own.items()
    ]
    for function, (program, keeps, number) in COUNTED.items():
        table.append(_or_why({"program": function, kept: keeps}, "rows", partial(asked, function, program, number)))
    return table


def own_row_us(samples: int, size: int) -> float:
    """Return the time that a worker of clearcap takes for a row whose run takes no time [us]."""
    from campaign.coordinator.submit import submit
    from campaign.spec.load import load_campaign
    from campaign.store import open_store
    from campaign.worker.batch import run_batch
    from campaign.worker.messages import BatchRequest, CampaignAddress
    from tests.campaign.fake_engine import simulate

    with tempfile.TemporaryDirectory(prefix="clearcap-bench-") as folder:
        store = open_store(folder)
        plan = submit(store, load_campaign("c60", samples=samples), size, simulate)
        address = CampaignAddress.of(store, plan, simulate)
        run_batch(address, BatchRequest(0))
        began = process_time()
        for batch in range(1, len(plan.batches)):
            run_batch(address, BatchRequest(batch))
        return 1e6 * (process_time() - began) / (samples - size)


def starts() -> list[Row]:
    """Return the processor time of a process that imports a program, makes a model and takes a step."""
    task = {"motion": "double_pendulum", "step": 1e-3, "every": 1e-3, "count": 1}

    def spent(call: Callable[[], object]) -> Row:
        times = []
        for _ in range(ROUNDS + 1):  # the first installs the program and reads its files
            before = processor_s()
            call()
            times.append(processor_s() - before)
        own = table[0]["cpu s"] if table else min(times[1:])
        return {"cpu s": min(times[1:]), "to clearcap": min(times[1:]) / own}

    table: list[Row] = []
    table.append({"start": "clearcap simulate incline"} | spent(lambda: command_s("simulate", "incline")))
    for name, kinds in INTEGRATORS.items():
        call = partial(ask, name, "peer_motions.py", call=name.lower(), integrator=kinds[1][0], **task)
        table.append(_or_why({"start": name}, "cpu s", partial(spent, call)))
    return table


# -- heaps of balls ----------------------------------------------------------------------------------------------------


def heap_rows() -> list[Row]:
    """Return time and residual of the first step of a heap, from nothing, for clearcap and MuJoCo."""
    return [row for balls in BALLS for row in _heap_rows(balls)]


def _heap_rows(balls: int) -> list[Row]:
    heap, name = heaps.build_heap("balls", balls), f"{balls} balls"
    nc, (arrays, number) = len(heap.pair), heaps.heap_arrays(heap)
    arrays.q[:] = heaps.free_velocities(heap, arrays, number, 0)
    own, steps, residual = heaps.time_heap(nc, arrays, np.zeros((nc, 3)), process_time)
    task = {"centres": heap.centre.tolist(), "masses": heap.mass.tolist(), "friction": heaps.FRICTION}

    def asked(hard: bool) -> Row:
        found = ask("MuJoCo", "peer_motions.py", call="heap", hard=hard, **task)
        off = natural_map_residual(heaps.dense_problem(heap), impulses_of(heap, found["forces"]))
        row = {"ms": found["ms"], "to clearcap": 1e-3 * found["ms"] / own, "iterations": found["iterations"]}
        return row | {"residual": off, "ms a step, 100 steps": found["step_ms"], "deepest m": found["deepest"]}

    first = {"heap": name, "program": "clearcap", "ms": 1e3 * own, "to clearcap": 1.0, "iterations": steps}
    table = [first | {"residual": residual, "ms a step, 100 steps": "", "deepest m": ""}]
    for hard in (False, True):
        row = {"heap": name, "program": f"MuJoCo, {'hard' if hard else 'default'}"}
        table.append(_or_why(row, "ms", partial(asked, hard)))
    return table


def impulses_of(heap: heaps.Heap, forces: list[list[float]], gravity: float = 9.81) -> np.ndarray:
    """Return the impulses of a heap in its own frames; bodies, and force on the second [N], of each contact given."""
    on = {(int(a), int(b)): np.array(force) for a, b, *force in forces}
    on |= {(b, a): -force for (a, b), force in on.items()}
    found = [F @ on[b, a] for (a, b), F in zip(heap.pair.tolist(), heap.frame, strict=True)]
    return np.concatenate(found) / gravity  # a step in which a free body reaches 1 m/s, as in the heap's problem


# -- mechanisms --------------------------------------------------------------------------------------------------------


def motion_rows(motion: str) -> list[Row]:
    """Return step, time and error of a motion by each program and integrator."""
    every, count, steps, _ = MOTIONS[motion]
    ideal, table = motion != "clearance_pendulum", []
    reference = own_motion(motion, steps[-1] / FINER, 1)[0]

    def asked(program: str, way: str, step: float, repeats: int) -> tuple[np.ndarray, float]:
        task = {"motion": motion, "step": step, "every": every, "count": count, "repeats": repeats, "integrator": way}
        found = ask(program, "peer_motions.py", call=program.lower(), **task)
        return np.array(found["found"]), found["s"]

    ways: dict[str, Callable[[float, int], tuple[np.ndarray, float]]] = {"clearcap": partial(own_motion, motion)}
    ways |= {f"{name} {way}": partial(asked, name, way) for name, kinds in INTEGRATORS.items() for way in kinds[ideal]}
    for name, run in ways.items():
        try:
            fine = run(steps[-1] / FINER, 1)[0]
            for step in steps:
                found, s = run(step, REPEATS)
                row = {"motion": motion, "program": name, "step ms": 1e3 * step, "ms": 1e3 * s}
                row |= {"us a step": 1e6 * s * step / (every * count), "error": float(np.abs(found - fine).mean())}
                table.append(row | {"reference off": float(np.abs(fine - reference).mean())})
        except NotMeasured as why:
            table.append({"motion": motion, "program": name, "step ms": str(why)})
    return table


def described(motion: str, step: float) -> Row:
    """Describe a shipped mechanism with a fixed step [s], to its last instant; the slider-crank on an ideal guide."""
    data, (every, count, _, responses) = shipped(motion), MOTIONS[motion]
    data["simulation"] |= {"step": step, "horizon": every * count}
    data["responses"] = {name: data["responses"][name] for name in responses}
    data.pop("phases", None)
    if motion == "slider_crank":
        guide = data["joints"]["guide"]
        sides = {side: {key: guide[side][key] for key in ("body", "point", "axis")} for side in ("guide", "slider")}
        data["joints"]["guide"] = {"type": "prismatic", **sides}
        del data["materials"]
    return data


def own_motion(motion: str, step: float, repeats: int) -> tuple[np.ndarray, float]:
    """Return what is compared at each instant, and the processor time of all steps [s]."""
    (every, count, _, _), data = MOTIONS[motion], described(motion, step)
    run, mechanism, best = recorded(data), made(data), np.inf  # the run is recorded first, not timed
    for _ in range(repeats):
        assembly, control = assemble(mechanism), control_of(mechanism, True)
        began = process_time()
        drive(assembly, control, LONGEST)
        best = min(best, process_time() - began)
    instants = every * np.arange(1, count + 1)
    return np.stack([at(run, instants, response) for response in run.responses.values()], axis=1), best


def at_equal_error(points: list[Row]) -> list[Row]:
    """Return the time of each program at the error of clearcap's fourth step, on a line through the logarithms.

    If a program's errors are all larger or all smaller, its longest or shortest time is a limit, and said to be one.
    """
    table, lines = [], dict[tuple[str, str], list[Row]]()
    for row in points:
        if "error" in row:
            lines.setdefault((row["motion"], row["program"]), []).append(row)
    for (motion, program), line in lines.items():
        own = lines[motion, "clearcap"]
        error = own[3]["error"]
        limit, ms = _time_at(error, line)
        row = {"motion": motion, "error": error, "program": program, "ms": f"{limit}{ms:.3g}"}
        table.append(row | {"to clearcap": f"{limit}{ms / _time_at(error, own)[1]:.2g}"})
    return table


def _time_at(error: float, line: list[Row]) -> tuple[str, float]:
    """Return the time at an error [ms], after "" or, if only a limit is known, "< " or "> "."""
    errors, times = (np.array([row[key] for row in line]) for key in ("error", "ms"))
    if error > errors.max():
        return "< ", float(times.min())
    if error < errors.min():
        return "> ", float(times.max())
    return "", float(np.exp(np.polyval(np.polyfit(np.log(errors), np.log(times), 1), np.log(error))))
