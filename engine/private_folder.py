"""A folder that nobody else can have filled, for data that run as code when they are read.

The way to it is judged as ssh judges the way to a user's keys. Every folder and link on the way belongs to this user or
to root, and nobody else can write there, unless a sticky bit keeps others from replacing what is not theirs. Where only
this user's private group can write, only he can: such are homes where the umask is 002.
"""

import grp
import os
import pwd
import stat
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from engine.errors import FolderError

_LINKS = 40  # as many as Linux follows
_OTHERS_ENTER = stat.S_IXGRP | stat.S_IXOTH
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True)
class _Step:
    """A folder or link on the way to a folder."""

    path: Path
    status: os.stat_result

    @property
    def mode(self) -> int:
        return self.status.st_mode


def private_folder(base: Path, *names: str) -> Path:
    """Make a folder that is this user's alone, mode 0700, or check the one that is there.

    Parameters
    ----------
    base : Path
        A folder, which may be root's and shared, as ``/tmp`` is. It is made if it is missing.
    names : str
        Folders below it, each in the one before. All become this user's alone.

    Returns
    -------
    Path
        The last of them, without links on the way.

    Raises
    ------
    FolderError
        If somebody else could have changed what is in the folder, or could replace it.
    OSError
        If the folder cannot be made or written.
    """
    folder = _trusted_folder(base.absolute())
    for name in names:
        folder = _trusted_folder(folder / name, mend=name != names[-1])
        _own(folder).chmod(0o700)
    _check_content(folder)
    return folder


def _trusted_folder(path: Path, mend: bool = False) -> Path:
    """Return a folder by the way without links, after each step is judged; make what is missing.

    With ``mend`` others may write in the last step, because its mode will be mended.
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
    """Return a folder or link; make a folder if nothing is there."""
    with suppress(FileNotFoundError):
        return _Step(path, path.lstat())
    with suppress(FileExistsError):  # another process of this user was quicker
        path.mkdir(0o700)
    return _Step(path, path.lstat())


def _judged(step: _Step, way: list[_Step], mend: bool = False) -> _Step:
    """Return a step, if nobody but this user and root can replace it or what is in it."""
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
    """Return the users to whom the next step may belong: this one, and root.

    A user namespace (rootless containers) shows the real root as the overflow user, and all others that it does not map
    too. So he counts as root only where nobody could have put the step but root.
    """
    keepers = {os.geteuid(), 0}
    if not (way and way[-1].mode & _OTHERS_WRITE):
        with suppress(OSError):
            if Path("/proc/self/uid_map").read_text().split() != ["0", "0", "4294967295"]:
                keepers.add(int(Path("/proc/sys/kernel/overflowuid").read_text()))
    return keepers


def _private_group(step: _Step) -> bool:
    """Tell whether a folder's group is this user alone: his first group, with his name, without other members."""
    try:
        user, group = pwd.getpwuid(os.geteuid()), grp.getgrgid(step.status.st_gid)
    except KeyError:
        return False
    alone = user.pw_gid == group.gr_gid and user.pw_name == group.gr_name and set(group.gr_mem) <= {user.pw_name}
    return alone and not _has_access_list(step.path)


def _has_access_list(path: Path) -> bool:
    """Tell whether a folder has an access control list, which may let others in under the name of the group."""
    if not hasattr(os, "listxattr"):
        return False
    with suppress(OSError):
        return "system.posix_acl_access" in os.listxattr(path)
    return False


def _own(folder: Path) -> Path:
    """Return a folder if it is this user's."""
    owner = folder.stat().st_uid
    if owner != os.geteuid():
        raise FolderError(f"{folder} belongs to {_user(owner)}")
    return folder


def _check_content(folder: Path) -> None:
    """Refuse a folder with anything in it that is neither this user's nor root's, or that is a link."""
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
