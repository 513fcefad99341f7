"""A folder that no other user can have filled, for data that run as code when they are read.

Its path is checked as ssh checks the path to a user's keys. Every folder and link on the path belongs to this user or
to root, and nobody else can write there, unless a sticky bit keeps others from replacing files that are not theirs. A
folder that only this user's private group can write is accepted: home folders are like that where the umask is 002.
"""

import grp
import os
import pwd
import stat
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from engine.errors import FolderError

_LINKS = 40  # the limit of Linux
_OTHERS_ENTER = stat.S_IXGRP | stat.S_IXOTH
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True)
class _Step:
    """A folder or link on the path to a folder."""

    path: Path
    status: os.stat_result

    @property
    def mode(self) -> int:
        return self.status.st_mode


def private_folder(base: Path, *names: str) -> Path:
    """Return a folder that only this user can access, mode 0700, created or checked; links on its path are resolved.

    ``base`` may belong to root and be shared, as ``/tmp`` is; ``names``, each inside the previous one, become private
    to this user. Raise FolderError if another user could have changed the content of the folder or could replace it,
    and OSError if it cannot be created or written.
    """
    folder = _trusted_folder(base.absolute())
    for name in names:
        folder = _trusted_folder(folder / name, mend=name != names[-1])
        _own(folder).chmod(0o700)
    _check_content(folder)
    return folder


def user_cache(*names: str) -> Path:
    """Return such a folder in the user's cache folder; raise RuntimeError, too, if this user has no home folder."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    return private_folder(base, "clearcap", *names)


def _trusted_folder(path: Path, mend: bool = False) -> Path:
    """Return a folder with all links on its path resolved, after checking each step; create missing folders.

    With ``mend``, others may have write access to the last step, because its mode will be corrected.
    """
    way = [_judged(_step(Path(path.anchor)), [])]
    left, links = list(reversed(path.parts[1:])), 0
    while left:
        name = left.pop()
        if name == "..":
            way = way[:-1] or way
            continue
        step = _judged(_step(way[-1].path / name), way, mend and not left)
        if stat.S_ISLNK(step.mode):
            links += 1
            if links > _LINKS:
                raise FolderError(f"{path}: there are more than {_LINKS} links on the way")
            target = step.path.readlink()
            left += reversed(target.parts[1:] if target.is_absolute() else target.parts)
            way = way[:1] if target.is_absolute() else way
        else:
            way.append(step)
    return way[-1].path


def _step(path: Path) -> _Step:
    """Return a folder or link; create a folder if nothing is there."""
    with suppress(FileNotFoundError):
        return _Step(path, path.lstat())
    with suppress(FileExistsError):  # another process of this user was faster
        path.mkdir(0o700)
    return _Step(path, path.lstat())


def _judged(step: _Step, way: list[_Step], mend: bool = False) -> _Step:
    """Return a step after checking that only this user and root can replace it or its content."""
    if step.status.st_uid not in _keepers(way):
        raise FolderError(f"{step.path} belongs to {_user(step.status.st_uid)}")
    sheltered = any(each.status.st_uid == os.geteuid() and not each.mode & _OTHERS_ENTER for each in way)
    if stat.S_ISLNK(step.mode) or step.mode & stat.S_ISVTX or sheltered or mend:
        return step
    if step.mode & stat.S_IWOTH:
        raise FolderError(f"everybody can write in {step.path} (mode {stat.S_IMODE(step.mode):04o})")
    if step.mode & stat.S_IWGRP and not _private_group(step):
        mode = f"mode {stat.S_IMODE(step.mode):04o}"
        raise FolderError(f"the group {_group(step.status.st_gid)} can write in {step.path} ({mode})")
    return step


def _keepers(way: list[_Step]) -> set[int]:
    """Return the users who may own the next step: this user and root.

    In a user namespace (rootless containers) the real root appears as the overflow user, as do all other users that the
    namespace does not map. So the overflow user counts as root only where nobody but root could have created the step.
    """
    keepers = {os.geteuid(), 0}
    if not (way and way[-1].mode & _OTHERS_WRITE):
        with suppress(OSError):
            if Path("/proc/self/uid_map").read_text().split() != ["0", "0", "4294967295"]:
                keepers.add(int(Path("/proc/sys/kernel/overflowuid").read_text()))
    return keepers


def _private_group(step: _Step) -> bool:
    """Return whether a folder's group is this user's alone: their primary group, named like them, no other member."""
    try:
        user, group = pwd.getpwuid(os.geteuid()), grp.getgrgid(step.status.st_gid)
    except KeyError:
        return False
    alone = user.pw_gid == group.gr_gid and user.pw_name == group.gr_name and set(group.gr_mem) <= {user.pw_name}
    return alone and not _has_access_list(step.path)


def _has_access_list(path: Path) -> bool:
    """Return whether a folder has an access control list, which may grant others access as members of the group."""
    if not hasattr(os, "listxattr"):
        return False
    with suppress(OSError):
        return "system.posix_acl_access" in os.listxattr(path)
    return False


def _own(folder: Path) -> Path:
    """Return a folder after checking that it belongs to this user."""
    owner = folder.stat().st_uid
    if owner != os.geteuid():
        raise FolderError(f"{folder} belongs to {_user(owner)}")
    return folder


def _check_content(folder: Path) -> None:
    """Refuse a folder that contains a link, or anything that belongs to neither this user nor root."""
    for parent, folders, files in os.walk(folder, onerror=_fail):
        for name in (*folders, *files):
            entry = Path(parent, name)
            with suppress(FileNotFoundError):  # another process has replaced it
                status = entry.lstat()
                if status.st_uid not in {os.geteuid(), 0}:
                    raise FolderError(f"{entry} belongs to {_user(status.st_uid)}")
                if stat.S_ISLNK(status.st_mode):
                    raise FolderError(f"{entry} is a link")


def _fail(error: OSError) -> None:
    raise error


def _user(number: int) -> str:
    try:
        return f"{pwd.getpwuid(number).pw_name} (user {number})"
    except KeyError:
        return f"user {number}"


def _group(number: int) -> str:
    try:
        return f"{grp.getgrgid(number).gr_name} ({number})"
    except KeyError:
        return f"{number}"
