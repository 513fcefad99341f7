"""What resists rolling and spinning at a contact: a moment of at most an arm times the normal force, set-valued.

Each such contact has companions, contacts of their own after all others: one for the relative rotation about its
tangents (ROLLING), one about its normal (SPINNING). A companion is solved like the friction of an ideal joint: a weight
presses it with the largest moment, see `contacts.press`, and Coulomb's law with a coefficient of 1 bounds the moment by
it. That of a step follows from the normal impulse of the same step: the problem is solved again until both agree.
"""

from engine.jit import inner, not_inlined
from engine.kernels.broad_phase import update_contact
from engine.kernels.contacts import contact_velocity

SAME = 1e-7  # share of the largest moment by which it may differ from that of the last problem
LOADED = 1e-9  # share of the largest normal impulse, below which a contact resists nothing


@inner
def begin_rolling(contacts, state, work, time):
    """Activate the companions of the active contacts that carried load, with its moments in a step of ``time``."""
    for i in range(contacts.arm.shape[0]):
        if contacts.arm[i] > 0.0:
            p = contacts.partner[i]
            work.active[i] = work.active[p] and state.r[p, 0] > 0.0 and state.r[i, 0] > 0.0
            if work.active[i]:
                contacts.bound[i] = contacts.breakaway[i] = contacts.arm[i] * state.r[p, 0] / time
            else:
                state.r[i, 0], state.r[i, 1], state.r[i, 2] = 0.0, 0.0, 0.0


@not_inlined
def match_rolling(contacts, state, work, time):
    """Give each companion the largest moment at the normal impulse just found; return how many had another one."""
    changed, largest = 0, 0.0
    for i in range(contacts.arm.shape[0]):
        if contacts.arm[i] == 0.0 and contacts.bound[i] == 0.0:
            largest = max(largest, state.r[i, 0])
    for i in range(contacts.arm.shape[0]):
        if contacts.arm[i] == 0.0:
            continue
        p = contacts.partner[i]
        if not (work.active[p] and state.r[p, 0] > LOADED * largest):
            if work.active[i]:
                work.active[i] = False
                changed += 1
            state.r[i, 0], state.r[i, 1], state.r[i, 2] = 0.0, 0.0, 0.0
            continue
        moment = contacts.arm[i] * state.r[p, 0] / time
        if not work.active[i]:
            work.active[i], work.shift[i] = True, 0.0
            update_contact(contacts, state, work.broad_phase, work.sites, i, work.gap)
            contact_velocity(contacts, state.x, state.R, work.sites, work.free, i, work.q)
            changed += 1
        elif abs(moment - contacts.bound[i]) > SAME * moment:
            changed += 1
        contacts.bound[i] = contacts.breakaway[i] = moment
    return changed
