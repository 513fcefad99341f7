"""All cautions about a mechanism."""

from engine.mechanism import Mechanism
from engine.preflight.caution import Caution
from engine.preflight.customs import customs_of
from engine.preflight.doubles import doubles_of
from engine.preflight.pace import pace_of
from engine.preflight.start_gaps import start_gap_cautions

MOST_BODIES = 40  # in a mechanism whose small motions are examined; the time grows with the third power


def cautions(mechanism: Mechanism) -> list[Caution]:
    """Return the cautions about a mechanism that `engine.check` accepts: numbers, then motions, in the file's order."""
    drawn = [*start_gap_cautions(mechanism), *doubles_of(mechanism)]
    numbers = [*customs_of(mechanism), *pace_of(mechanism)]
    moving = sum(not body.fixed for body in mechanism.bodies.values())
    ends_at_rest = any(phase.duration is None and phase.until is None for phase in mechanism.phases)
    if numbers or not ends_at_rest or not 0 < moving <= MOST_BODIES:
        return [*numbers, *drawn]
    from engine.assembly import assemble
    from engine.preflight.early_rest import early_rest_of
    from engine.preflight.perpetual import perpetual_of
    from engine.preflight.small_motions import small_motions
    from engine.preflight.unloaded import unloaded_of

    small = small_motions(assemble(mechanism))
    return [*drawn, *early_rest_of(mechanism, small), *unloaded_of(mechanism, small), *perpetual_of(mechanism, small)]
