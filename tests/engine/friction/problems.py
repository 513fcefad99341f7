"""Friction problems made to be hard: random rigid bodies in contact, redundant, of uneven mass."""

import numpy as np

from engine.friction import FrictionProblem

HARD_KINDS = ("static", "moving", "open")  # of the seeds 0, 1, 2, 3, ... in turn


def random_problem(
    seed: int, contacts: int, bodies: int = 7, kind: str = "moving", mass_ratio: float = 10.0
) -> FrictionProblem:
    """Make ``contacts`` contacts between ``bodies`` bodies and the ground.

    kind: "static" presses the bodies together (many contacts stick), "moving" and "impact" have random velocities.
    """
    rng = np.random.default_rng(seed)
    n = 6 * bodies
    mass = np.exp(rng.uniform(0, np.log(mass_ratio), bodies))
    M = np.zeros((n, n))
    for b in range(bodies):
        M[6 * b : 6 * b + 3, 6 * b : 6 * b + 3] = mass[b] * np.eye(3)
        root = np.eye(3) + 0.3 * rng.standard_normal((3, 3))
        M[6 * b + 3 : 6 * b + 6, 6 * b + 3 : 6 * b + 6] = mass[b] * 10 * root @ root.T
    H = np.zeros((3 * contacts, n))
    for i in range(contacts):
        a = i % bodies
        b = int(rng.integers(-1, bodies))
        frame = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        for body, sign in ((a, 1.0), (b, -1.0)):
            if body < 0 or (body == a and sign < 0):
                continue
            arm = 5 * rng.standard_normal(3)
            for k in range(3):
                H[3 * i + k, 6 * body : 6 * body + 3] = sign * frame[:, k]
                H[3 * i + k, 6 * body + 3 : 6 * body + 6] = sign * np.cross(arm, frame[:, k])
    speed = {"static": 1e-3, "moving": 1.0, "impact": 100.0}[kind]
    q = H @ (speed * rng.standard_normal(n))
    if kind == "static":  # a load that presses on every contact
        push = np.zeros(3 * contacts)
        push[::3] = rng.uniform(0.5, 1.5, contacts)
        q = -speed * H @ np.linalg.solve(M, H.T @ push)
    return FrictionProblem(M, H, q, rng.uniform(0.1, 0.3, contacts))


def hard_problem(seed: int, change: float = 0.0) -> FrictionProblem:
    """Make a problem that is hard in every way at once, and has a solution.

    7 to 12 bodies whose masses differ by up to 10,000 times, 6 to 120 contacts, up to half of them copies of others,
    friction from none to 1.3. The bodies rest under a load that presses on every contact, which those normal impulses
    hold; or they move, or approach contacts that are still open, as in a time step. There w = -v gives u_N > 0 and
    u_T = 0 everywhere, and a problem with such a velocity has a solution (Acary et al., ZAMM 91 (2011), 155-175).
    ``change``: make a neighbour of that problem, the load or the velocities changed by this share.
    """
    rng = np.random.default_rng([seed, 16])
    bodies, contacts = int(rng.integers(7, 13)), int(rng.integers(6, 121))
    kind = HARD_KINDS[seed % 3]
    once = random_problem(seed, contacts, bodies, "static" if kind == "static" else "moving", mass_ratio=1e4)
    q, mu = once.q.reshape(-1, 3).copy(), rng.uniform(0, 1.3, contacts) * (rng.random(contacts) < 0.9)
    if kind == "static":
        push = np.zeros(3 * contacts)
        push[::3] = 1e-3 * change * rng.random(contacts)
        q -= (once.H @ np.linalg.solve(once.M, once.H.T @ push)).reshape(-1, 3)
    else:
        q += change * (once.H @ rng.standard_normal(once.M.shape[0])).reshape(-1, 3)
        q[:, 0] += (0.1 if kind == "moving" else 1.0) * rng.exponential(np.abs(q).mean(), contacts)
    copied = rng.random(contacts) < rng.uniform(0, 0.5)
    of = np.where(copied, rng.integers(0, contacts, contacts), np.arange(contacts))
    H = once.H.reshape(contacts, 3, -1)[of].reshape(3 * contacts, -1)
    return FrictionProblem(once.M, H, q[of].ravel(), mu[of])


def projected_gauss_seidel(problem: FrictionProblem, sweeps: int = 20_000, tolerance: float = 1e-10):
    """Solve by an independent method: one contact at a time, projected on its cone."""
    nc = problem.mu.size
    W = problem.H @ np.linalg.solve(problem.M, problem.H.T)
    r = np.zeros(3 * nc)
    for _ in range(sweeps):
        change = 0.0
        for i in range(nc):
            rows = slice(3 * i, 3 * i + 3)
            rho = 1 / np.linalg.eigvalsh(W[rows, rows]).max()
            u = W[rows] @ r + problem.q[rows]
            u[0] += problem.mu[i] * np.hypot(u[1], u[2])
            new = project_cone(problem.mu[i], r[rows] - rho * u)
            change = max(change, float(np.abs(new - r[rows]).max()))
            r[rows] = new
        if change < tolerance * max(1e-300, float(np.abs(r).max())):
            break
    return r, W @ r + problem.q


def project_cone(mu: float, x: np.ndarray) -> np.ndarray:
    """Project on Coulomb's cone, written from its definition by cases."""
    t = float(np.hypot(x[1], x[2]))
    if t <= mu * x[0]:
        return x.copy()
    if mu * t <= -x[0]:
        return np.zeros(3)
    n = (x[0] + mu * t) / (1 + mu**2)
    return np.array([n, mu * n * x[1] / t, mu * n * x[2] / t])


def natural_map_residual(problem: FrictionProblem, r: np.ndarray) -> float:
    """Compute the design's residual in plain NumPy."""
    W = problem.H @ np.linalg.solve(problem.M, problem.H.T)
    u = (W @ r + problem.q).reshape(-1, 3)
    s = np.mean(np.diag(W)) * r.reshape(-1, 3)
    shifted = u.copy()
    shifted[:, 0] += problem.mu * np.hypot(u[:, 1], u[:, 2])
    miss = [a - project_cone(m, a - b) for m, a, b in zip(problem.mu, s, shifted, strict=True)]
    size = max(np.linalg.norm(problem.q), np.linalg.norm(s), np.linalg.norm(u))
    return float(np.linalg.norm(miss) / size) if size else 0.0
