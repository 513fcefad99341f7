"""Siconos on friction problems: `python3 siconos_solvers.py IN.npz OUT.npz TOLERANCE REPEATS`.

`benchmarks.against_siconos` runs this file with the Python that has Siconos, so it imports only NumPy and Siconos.
"""

import sys
from time import perf_counter

import numpy as np
import siconos.numerics as sn

SOLVERS = {"NSGS": sn.SICONOS_FRICTION_3D_NSGS, "NSN_AC": sn.SICONOS_FRICTION_3D_NSN_AC}
ITERATIONS = {"NSGS": 100_000, "NSN_AC": 1000}


def main(source: str, target: str, tolerance: float, repeats: int) -> None:
    """Solve every problem with every solver from a cold start; write impulses, fastest times [us] and iterations."""
    problems, found = np.load(source), {}
    for number in range(int(problems["count"])):
        W, q, mu = (problems[f"{name}{number}"] for name in ("W", "q", "mu"))
        problem = sn.FrictionContactProblem(3, W, q, mu)
        for name, solver in SOLVERS.items():
            best = np.inf
            for _ in range(repeats):
                options = sn.SolverOptions(solver)
                options.dparam[sn.SICONOS_DPARAM_TOL] = tolerance
                options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = ITERATIONS[name]
                r, u = np.zeros(q.size), np.zeros(q.size)
                start = perf_counter()
                sn.fc3d_driver(problem, r, u, options)
                best = min(best, perf_counter() - start)
            found[f"{name}_r{number}"] = r
            found[f"{name}_us{number}"] = 1e6 * best
            found[f"{name}_iterations{number}"] = options.iparam[sn.SICONOS_IPARAM_ITER_DONE]
    np.savez(target, **found)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), int(sys.argv[4]))
