"""A private folder is made, fixed or refused."""

import grp
import os
import pwd
from pathlib import Path
from types import SimpleNamespace

import pytest

from engine import FolderError
from engine.platform import private_folder as module
from engine.platform.private_folder import private_folder

OTHER = 20002


def mode(path: Path) -> int:
    """Return the permissions of a file or folder."""
    return path.stat().st_mode & 0o7777


@pytest.fixture
def base(open_folder):
    """Return a folder that others can enter, on a way that they can enter."""
    return open_folder


@pytest.fixture
def shared_group(monkeypatch):
    """Give every folder a group with another member."""
    monkeypatch.setattr(grp, "getgrgid", lambda gid: SimpleNamespace(gr_gid=gid, gr_name="staff", gr_mem=["bob"]))


@pytest.fixture
def private_group(monkeypatch):
    """Give this user a group of his own."""
    user = SimpleNamespace(pw_name="ann", pw_gid=os.getgid())
    group = SimpleNamespace(gr_gid=os.getgid(), gr_name="ann", gr_mem=[])
    monkeypatch.setattr(pwd, "getpwuid", lambda number: user)
    monkeypatch.setattr(grp, "getgrgid", lambda number: group)
    return group


@pytest.fixture
def umask():
    """Let what is made be open to all, as far as it is asked for."""
    before = os.umask(0)
    yield
    os.umask(before)


def test_missing_folders_are_made(base, umask):
    """All of them, for this user alone whatever the umask."""
    folder = private_folder(base / "cache", "ours", "build")
    assert folder == base / "cache/ours/build"
    assert [mode(each) for each in (base / "cache", base / "cache/ours", folder)] == [0o700] * 3
    assert private_folder(base / "cache", "ours", "build") == folder


def test_our_folders_are_mended(base):
    """Mode 0700, and what is in them stays; the folder they are in is left alone."""
    (base / "ours/build").mkdir(parents=True)
    (base / "ours").chmod(0o777)
    (base / "ours/build").chmod(0o755)
    (base / "ours/build/file").touch()
    folder = private_folder(base, "ours", "build")
    assert (mode(base), mode(base / "ours"), mode(folder)) == (0o755, 0o700, 0o700)
    assert (folder / "file").exists()


@pytest.mark.parametrize("open_to_all", ["", "above", "above/build"])
def test_where_everybody_writes(base, open_to_all):
    """A folder above, or the last one, is refused by name and mode; a sticky one above is good."""
    (base / "above/build").mkdir(parents=True)
    (base / open_to_all).chmod(0o777)
    with pytest.raises(FolderError, match=f"everybody can write in {base / open_to_all} .mode 0777"):
        private_folder(base / "above", "build")
    if open_to_all != "above/build":
        (base / open_to_all).chmod(0o1777)
        private_folder(base / "above", "build")


def test_where_a_group_writes(base, shared_group):
    """A folder of a group with others in it is refused."""
    base.chmod(0o775)
    with pytest.raises(FolderError, match=f"the group staff .* can write in {base} .mode 0775"):
        private_folder(base, "build")


def test_where_the_private_group_writes(base, private_group):
    """A user's own group is he himself, until it has another member or another name."""
    base.chmod(0o2775)
    os.chown(base, -1, os.getgid())
    private_folder(base, "build")
    private_group.gr_mem = ["ann"]
    private_folder(base, "build")
    private_group.gr_mem = ["ann", "bob"]
    with pytest.raises(FolderError, match="the group ann"):
        private_folder(base, "build")
    private_group.gr_mem, private_group.gr_name = [], "users"
    with pytest.raises(FolderError, match="the group users"):
        private_folder(base, "build")


def test_access_lists(base, private_group, monkeypatch):
    """A list of access shows as rights of the group, so it is none of the private group."""
    base.chmod(0o775)
    os.chown(base, -1, os.getgid())
    monkeypatch.setattr(os, "listxattr", lambda path: ["user.note"])
    private_folder(base, "build")
    monkeypatch.setattr(os, "listxattr", lambda path: ["system.posix_acl_access"])
    with pytest.raises(FolderError, match="can write"):
        private_folder(base, "build")


def test_behind_a_closed_door(base, shared_group):
    """Below a folder that nobody else can enter, modes do not matter; a link leads out again."""
    home = base / "home"
    (home / "open/build").mkdir(parents=True)
    (home / "open").chmod(0o777)
    home.chmod(0o700)
    private_folder(home / "open", "build")
    outside = base / "outside"
    outside.mkdir()
    outside.chmod(0o777)
    for number, target in enumerate((outside, Path("../outside"))):
        (home / f"link{number}").symlink_to(target)
        with pytest.raises(FolderError, match=f"everybody can write in {outside}"):
            private_folder(home / f"link{number}", "build")


def test_links(base):
    """A link of this user is followed, and the folder's true path returned; a circle is an error."""
    (base / "true").mkdir()
    (base / "link").symlink_to("true")
    (base / "away").mkdir()
    (base / "away/back").symlink_to(base / "away/../link")
    assert private_folder(base / "away/back", "build") == base / "true/build"
    (base / "circle").symlink_to("circle")
    with pytest.raises(FolderError, match="more than 40 links"):
        private_folder(base / "circle", "build")


def test_links_inside(base):
    """What is in the folder must be there itself."""
    folder = private_folder(base, "build")
    (folder / "sub").mkdir()
    (folder / "sub/index").symlink_to("/etc/passwd")
    with pytest.raises(FolderError, match="sub/index is a link"):
        private_folder(base, "build")


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, who can give files away")
@pytest.mark.parametrize("theirs", ["above", "above/build", "above/build/sub", "above/build/sub/index"])
def test_what_belongs_to_another_user(base, theirs):
    """Every folder and file that is another user's is named with its owner."""
    (base / "above/build/sub").mkdir(parents=True)
    (base / "above/build/sub/index").touch()
    os.chown(base / theirs, OTHER, OTHER)
    with pytest.raises(FolderError, match=f"{base / theirs} belongs to user {OTHER}"):
        private_folder(base / "above", "build")


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, who can give files away")
def test_a_link_of_another_user(base):
    """It is refused, wherever it leads."""
    (base / "true").mkdir()
    (base / "link").symlink_to("true")
    os.lchown(base / "link", OTHER, OTHER)
    with pytest.raises(FolderError, match=f"link belongs to user {OTHER}"):
        private_folder(base / "link", "build")


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, who can act as another user")
def test_a_user_who_is_not_root(base, monkeypatch):
    """Folders of root are good on the way; the last one must be the user's own."""
    monkeypatch.setattr(os, "geteuid", lambda: OTHER)
    (base / "above/build").mkdir(parents=True)
    with pytest.raises(FolderError, match=r"build .*root \(user 0\)"):
        private_folder(base / "above", "build")
    os.chown(base / "above/build", OTHER, OTHER)
    private_folder(base / "above", "build")


def test_a_user_namespace(base, monkeypatch):
    """Where root is not mapped, the overflow user is he, but not in a folder where others may put things."""
    above = module._Step(base, base.stat())
    maps = "0 0 4294967295"
    read = Path.read_text
    monkeypatch.setattr(
        Path, "read_text", lambda path, *more: {"uid_map": maps, "overflowuid": "65534\n"}.get(path.name) or read(path)
    )
    assert module._keepers([above]) == {os.geteuid(), 0}
    maps = "1000 1000 1\n"
    assert module._keepers([above]) == {os.geteuid(), 0, 65534}
    base.chmod(0o1777)
    assert module._keepers([module._Step(base, base.stat())]) == {os.geteuid(), 0}
