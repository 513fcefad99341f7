"""Programs that call a function for many samples, with one that takes no time: `python peer_rows.py PROGRAM ROWS`.

`benchmarks.peers` runs this file with the Python that has the programs, so it imports nothing else. A row is seven
values that are drawn and ten responses, as of the C-60. Prints the processor time of all rows [s], as JSON.
"""

import json
import sys
import tempfile
from pathlib import Path
from time import process_time

VALUES, RESPONSES, PART = 7, 10, 500  # PART: rows of a Parquet file


def respond(values):
    """Return responses that depend on every value."""
    total = sum((i + 1) * value for i, value in enumerate(values))
    return [10.0 + total * (i + 1) for i in range(RESPONSES)]


def drawn(rows):
    """Draw the values of all rows."""
    import numpy

    return numpy.random.default_rng(1).normal(size=(rows, VALUES)).tolist()


def bare_loop(rows, folder):
    """Call the function in a loop, and write each 500 rows as a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    values = drawn(rows)
    for first in range(0, rows, PART):
        part = [[*each, *respond(each)] for each in values[first : first + PART]]
        columns = {f"c{i}": column for i, column in enumerate(zip(*part, strict=True))}
        pq.write_table(pa.table(columns), folder / f"{first}.parquet")


def openturns(rows, folder):
    """Draw a sample, compute it with a function of Python, and write both as CSV."""
    import openturns as ot

    sample = ot.JointDistribution([ot.Normal()] * VALUES).getSample(rows)
    results = ot.PythonFunction(VALUES, RESPONSES, respond)(sample)
    sample.stack(results)
    sample.exportToCSVFile(str(folder / "all.csv"))


def joblib_one_process(rows, folder):
    """Compute all rows with joblib in this process; nothing is kept on disk."""
    from joblib import Parallel, delayed

    Parallel(n_jobs=1)(delayed(respond)(each) for each in drawn(rows))


def joblib_memory(rows, folder):
    """Keep every row in a file of its own, and look there before it is computed."""
    from joblib import Memory

    kept = Memory(folder, verbose=0).cache(respond)
    for each in drawn(rows):
        kept(each)


def monaco(rows, folder):
    """Compute all rows as cases of a simulation in one thread, which keeps nothing on disk."""
    import monaco
    from scipy.stats import norm

    def keep(case, *responses):
        for i, value in enumerate(responses):
            case.addOutVal(f"r{i}", value)

    functions = {
        "preprocess": lambda case: ([each.val for each in case.invals.values()],),
        "run": lambda values: tuple(respond(values)),
        "postprocess": keep,
    }
    quiet = {"verbose": False, "savecasedata": False, "savesimdata": False}
    sim = monaco.Sim("rows", rows, functions, singlethreaded=True, debug=True, resultsdir=folder, **quiet)
    for i in range(VALUES):
        sim.addInVar(f"v{i}", norm, {"loc": 0.0, "scale": 1.0})
    sim.runSim()


def dask(rows, folder):
    """Compute each row as a task of a cluster whose scheduler and one worker are in this process."""
    from distributed import Client, LocalCluster

    here = LocalCluster(1, threads_per_worker=1, processes=False, dashboard_address=None)
    with here as cluster, Client(cluster) as client:
        client.gather(client.map(respond, drawn(rows)))


def main(program, rows):
    """Compute a few rows, so that all is imported, then all of them by the clock."""
    call = globals()[program]
    with tempfile.TemporaryDirectory() as few, tempfile.TemporaryDirectory() as all_rows:
        call(10, Path(few))
        began = process_time()
        call(rows, Path(all_rows))
        print(json.dumps({"s": process_time() - began}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
