"""What is done to a campaign in a storm. Each function returns how many processes or files it really hit."""

import signal
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

from tests.campaign.storms.command import CLOCK
from tests.campaign.storms.disk import fill, remount, use_up_inodes
from tests.campaign.storms.modes import STAND_IN

LEASE = 60.0  # s, in which another machine sees that a coordinator is silent; half of it on a quiet machine
AFTER = 0.0, 3.0  # s, in which two coordinators believe that the campaign is theirs
SHORT = 1.0, 8.0  # s
FAULT = 1.0, 15.0  # s
WAIT = 20.0  # s, in which a file or a process that is to be hit is waited for
JUMPS = 8 * 3600.0, 40 * 86400.0, -10.0  # s: a night asleep, a flat battery, a correction


def hit(storm, role, number):
    """Send a signal to one process of a role."""
    return storm.send(number, storm.some(role, WAIT))


def hit_everything(storm, number):
    """Send a signal to all processes at once."""
    found = storm.processes()
    return storm.send(number, [process for role in found for process in found[role]])


def hit_child(storm, number):
    """Kill a worker, so that its batch is isolated, and then the subprocess that computes it."""
    return storm.send(number, _child(storm))


def _child(storm):
    """Return an isolated subprocess, for which a worker is killed that has work."""
    storm.wait(storm.parts, WAIT)
    hit(storm, "worker", signal.SIGKILL)
    return storm.some("child", WAIT)


def pause(storm, role, seconds):
    """Stop one process of a role for a while."""
    return storm.pause(storm.some(role, WAIT), storm.chance.uniform(*seconds))


def pause_beyond_lease(storm):
    """Stop the coordinator that holds the lease until another machine has taken over; then there are two."""
    storm.wait(lambda: storm.document("lease.json"), WAIT)
    lease, found = storm.document("lease.json"), storm.processes()["coordinator"]
    holder = [p for p in found if p.pid == lease.get("pid")]
    holder = holder or [p for p in found if storm.is_in_a_space_of_its_own(p)]
    stopped = storm.send(signal.SIGSTOP, holder[:1])
    if stopped and storm.wait(
        lambda: storm.document("lease.json").get("token") not in (lease.get("token"), None), LEASE
    ):
        storm.take_overs += 1
    storm.undo_after(storm.chance.uniform(*AFTER), lambda: storm.send(signal.SIGCONT, holder[:1]))
    return stopped


def pause_everything(storm):
    """Stop all processes for a while, as a laptop does that sleeps."""
    found = storm.processes()
    return storm.pause([process for role in found for process in found[role]], storm.chance.uniform(*SHORT))


def restart(storm):
    """End the server in order, and start the next one after a while."""
    away = ExitStack()
    away.enter_context(storm.supervisor.held())
    storm.undo_after(storm.chance.uniform(*SHORT), away.close)
    return hit(storm, "server", signal.SIGTERM)


def read_only(storm):
    """Have the disk refuse all writing for a while."""
    if not remount(storm.disk, "ro"):
        return 0
    storm.undo_after(storm.chance.uniform(*FAULT), lambda: remount(storm.disk, "rw"))
    return 1


def full(storm, fault):
    """Use up what the disk has, blocks or inodes, for a while."""
    filler = fault(storm.disk)

    def free():
        for path in [*filler.glob("*"), filler] if filler.is_dir() else [filler]:
            path.rmdir() if path.is_dir() else path.unlink()

    storm.undo_after(storm.chance.uniform(*FAULT), free)
    return 1


def damage(storm, change):
    """Change the content of a part, in place."""
    storm.wait(storm.parts, WAIT)
    for part in storm.chance.sample(parts := storm.parts(), min(1, len(parts))):
        content = part.read_bytes()
        part.write_bytes(change(content, storm.chance.randrange(len(content))))
        return 1
    return 0


def flipped(content, place):
    """Return bytes of which one is another."""
    return content[:place] + bytes([content[place] ^ 0x55]) + content[place + 1 :]


def truncated(content, place):
    """Return the first bytes."""
    return content[:place]


def remove(storm):
    """Remove a part."""
    storm.wait(storm.parts, WAIT)
    for part in storm.chance.sample(parts := storm.parts(), min(1, len(parts))):
        part.unlink()
        return 1
    return 0


def leave_temporary(storm):
    """Leave what a writer leaves that is killed."""
    parts = storm.folder / "parts"
    parts.mkdir(exist_ok=True)
    for name in (parts / "part-000001.parquet", storm.folder / "heartbeat.json"):
        name.with_name(f"{name.name}.0123456789ab-4242-01234567.tmp").write_bytes(b"PAR1")
    return 2


def spoil(storm, name):
    """Put garbage in the place of a small file; after a while do what the message says, and remove it."""
    path = storm.folder / name
    if not storm.wait(path.exists, WAIT):
        return 0
    garbage = storm.chance.randbytes(40)
    path.write_bytes(garbage)

    def restore():
        with suppress(FileNotFoundError):
            if path.read_bytes() == garbage:
                path.unlink()

    storm.undo_after(storm.chance.uniform(*SHORT), restore)
    return 1


def take_plan_away(storm):
    """Take the plan away when an isolated subprocess starts."""
    if not _child(storm):
        return 0
    plan, elsewhere = storm.folder / "plan.json", storm.disk / "plan.json"
    plan.rename(elsewhere)
    storm.undo_after(storm.chance.uniform(*FAULT), lambda: elsewhere.rename(plan))
    return 1


def jump(storm):
    """Have the coordinator's clock jump."""
    Path(storm.supervisor.environment[CLOCK]).write_text(str(storm.chance.choice(JUMPS)))
    return len(storm.some("coordinator", WAIT))


KILLS = {
    "kill worker": partial(hit, role="worker", number=signal.SIGKILL),
    "kill coordinator": partial(hit, role="coordinator", number=signal.SIGKILL),
    "kill isolated child": partial(hit_child, number=signal.SIGKILL),
    "kill everything": partial(hit_everything, number=signal.SIGKILL),
}
CLUSTER_KILLS = {
    "kill nanny": partial(hit, role="nanny", number=signal.SIGKILL),
    "kill scheduler": partial(hit, role="scheduler", number=signal.SIGKILL),
}
SERVER_KILLS = {
    "kill server": partial(hit, role="server", number=signal.SIGKILL),
    "kill job process": partial(hit, role="job process", number=signal.SIGKILL),
}
SIGNALS = {
    "SIGTERM coordinator": partial(hit, role="coordinator", number=signal.SIGTERM),
    "SIGINT coordinator": partial(hit, role="coordinator", number=signal.SIGINT),
    "SIGHUP coordinator": partial(hit, role="coordinator", number=signal.SIGHUP),
    "SIGTERM worker": partial(hit, role="worker", number=signal.SIGTERM),
    "SIGTERM isolated child": partial(hit_child, number=signal.SIGTERM),
}
SERVER_SIGNALS = {
    "SIGTERM server": partial(hit, role="server", number=signal.SIGTERM),
    "SIGINT server": partial(hit, role="server", number=signal.SIGINT),
    "restart server": restart,
}
FROM_A_TERMINAL = {"SIGINT coordinator", "SIGHUP coordinator"}  # which that of a server does not have
PAUSES = {
    "pause worker": partial(pause, role="worker", seconds=FAULT),
    "pause coordinator": partial(pause, role="coordinator", seconds=SHORT),
    "pause everything": pause_everything,
}
SERVER_PAUSES = {
    "pause server": partial(pause, role="server", seconds=FAULT),
    "pause job process": partial(pause, role="job process", seconds=FAULT),
}
BEYOND_LEASE = {"pause coordinator beyond its lease": pause_beyond_lease}
DISK = {
    "disk read-only": read_only,
    "disk full": partial(full, fault=fill),
    "no inodes left": partial(full, fault=use_up_inodes),
}
LOSSES = {
    "part damaged": partial(damage, change=flipped),
    "part truncated": partial(damage, change=truncated),
    "part removed": remove,
}
FILES = {
    **LOSSES,
    "temporary left": leave_temporary,
    "plan away while a child starts": take_plan_away,
    "heartbeat garbage": partial(spoil, name="heartbeat.json"),
    "lease garbage": partial(spoil, name="lease.json"),
    "manifest garbage": partial(spoil, name="manifest.json"),
    "state garbage": partial(spoil, name="state.json"),
}
TIME = {"clock jumps": jump}


def drawn(chance, mode):
    """Return the disturbances of a storm: of each sort some, in any order."""
    fewer = 1 if mode.has_server else 2
    kinds = chance.sample(sorted((KILLS | CLUSTER_KILLS if mode.clustered else KILLS).items()), fewer)
    signals = SIGNALS.keys() - FROM_A_TERMINAL if mode.has_server else SIGNALS
    kinds += [(kind, SIGNALS[kind]) for kind in chance.sample(sorted(signals), 1)]
    kinds += chance.sample(sorted((BEYOND_LEASE if mode.splits else PAUSES).items()), 1)
    for of_server in chance.sample((SERVER_KILLS, SERVER_SIGNALS, SERVER_PAUSES), 2) if mode.has_server else ():
        kinds += chance.sample(sorted(of_server.items()), 1)
    kinds += chance.sample(sorted(DISK.items()), 1) + chance.sample(sorted(FILES.items()), fewer)
    kinds += list(TIME.items()) if mode.command == STAND_IN and chance.random() < 0.4 else []
    chance.shuffle(kinds)
    return kinds


def strike(storm, disturb):
    """Disturb; a disk that is read-only or full just now protects its files from it."""
    try:
        return disturb(storm)
    except OSError:
        return 0
