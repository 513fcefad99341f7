"""All cautions about a mechanism, and one about a fixed step with which it does not come to rest."""

from collections.abc import Iterator

from engine.mechanism import Mechanism, set_values
from engine.preflight.plausibility import Caution, duplicates, fast_spins, implausible_numbers, stiff_springs
from engine.preflight.start_gaps import start_gap_cautions
from engine.simulate import simulate

MOST_BODIES = 40  # in a mechanism whose small motions are examined; the time grows with the third power

HALVINGS = 4
UNSTEADY = ("not_at_rest", "diverged")  # how a run ends with a step that is too long
LONGEST_TRIAL = 10.0  # s


def cautions(mechanism: Mechanism) -> list[Caution]:
    """Return the cautions about a mechanism that `engine.check` accepts: numbers, then motions, in the file's order."""
    drawn = [
        *(*_moved_start(mechanism), *start_gap_cautions(mechanism)),
        *(*duplicates(mechanism), *fast_spins(mechanism), *_closed_loops(mechanism)),
    ]
    numbers = [*implausible_numbers(mechanism), *stiff_springs(mechanism)]
    moving = sum(not body.fixed for body in mechanism.bodies.values())
    ends_at_rest = any(phase.duration is None and phase.until is None for phase in mechanism.phases)
    if numbers or not ends_at_rest or not 0 < moving <= MOST_BODIES:
        return [*numbers, *drawn]
    from engine.assembly import assemble
    from engine.preflight.motion_cautions import early_rest, undamped_modes, unloaded_cautions
    from engine.preflight.small_motions import small_motions

    small = small_motions(assemble(mechanism))
    return [
        *drawn,
        *early_rest(mechanism, small),
        *unloaded_cautions(mechanism, small),
        *undamped_modes(mechanism, small),
    ]


def _moved_start(mechanism: Mechanism) -> Iterator[Caution]:
    """Yield a caution if the assembly step moves bodies from where they are drawn."""
    from engine.assembly import assemble

    moved = assemble(mechanism).travel
    if moved:
        yield Caution(
            "simulation.assembly_travel",
            mechanism.simulation.assembly_travel,
            mechanism.unit("length"),
            "parts overlap as drawn, or ideal joints are open, so runs start from the nearest pose where that is not"
            f" so: it moves a body by {moved:.4g} {mechanism.unit('length')}",
            "",
            "correct the poses, or let it be if the drawing is meant so; with 0 such a start is refused",
        )


def _closed_loops(mechanism: Mechanism) -> list[Caution]:
    """Return the cautions about closed loops of ideal joints."""
    if sum(joint.ideal for joint in mechanism.joints.values()) < 2:
        return []
    from engine.assembly import assemble
    from engine.preflight.closed_loops import closed_loop_cautions

    return [*closed_loop_cautions(mechanism, assemble(mechanism))]


# Test whether a mechanism comes to rest with a fixed step, and otherwise which shorter step does.


def step_caution(mechanism: Mechanism, step: float, horizon: float | None = None) -> Caution | None:
    """Return a caution, naming the longest suitable step, if a mechanism does not come to rest with a fixed step.

    Half the step, a quarter of it and so on are tried, one run each. If none comes to rest, the step is not to blame.

    `horizon` is the longest simulated time; None means the mechanism's.
    """
    limit = min(LONGEST_TRIAL, mechanism.simulation.wall_limit)
    mechanism = set_values(mechanism, {"simulation.wall_limit": limit})
    unit, message = mechanism.unit("time"), ""
    for halvings in range(HALVINGS + 1):
        shorter = 0.5**halvings * step
        run = simulate(mechanism, step=shorter, horizon=horizon)
        if run.status not in UNSTEADY:
            break
        message = message or run.message
    if run.status != "ok" or not message:
        return None
    return Caution(
        "simulation.step",
        step,
        unit,
        f"with this fixed step the mechanism does not come to rest ({message})",
        f"up to {shorter:g} {unit}",
        f"with {shorter:g} {unit} it does: the longest that was tried, half and half again",
    )
