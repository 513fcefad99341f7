"""Read a file that anybody may have prepared, without hanging on a pipe or reading more than the expected size."""

import errno
import os
import stat
from pathlib import Path

_CHUNK = 1 << 20  # bytes read at a time
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


class UnfitFile(OSError):
    """The path is not a regular file, or the file is too large; ``strerror`` says which."""


def read_beginning(path: str | Path, count: int) -> bytes:
    """Return at most ``count`` bytes from the beginning of a regular file; raises the errors of `read_regular_file`."""
    with os.fdopen(_open_regular(path, follow_link=True), "rb", buffering=0) as file:
        return file.read(count)


def read_regular_file(path: str | Path, at_most: int, *, follow_link: bool = True) -> bytes:
    """Return the content of a regular file of at most ``at_most`` bytes.

    It never waits for a pipe or a terminal, and never reads more than allowed, even if the file grows meanwhile. Raise
    UnfitFile for a folder, a pipe, a socket, a device, a link unless ``follow_link``, or a file that is too large, and
    OSError if it does not exist or cannot be read.
    """
    with os.fdopen(_open_regular(path, follow_link=follow_link), "rb", buffering=0) as file:
        size = os.fstat(file.fileno()).st_size
        if size > at_most:
            raise UnfitFile(errno.EFBIG, f"has {size} bytes; allowed: up to {at_most}", str(path))
        content = bytearray()
        while chunk := file.read(_CHUNK):
            content += chunk
            if len(content) > at_most:
                raise UnfitFile(errno.EFBIG, f"has more than {at_most} bytes; allowed: up to {at_most}", str(path))
        return bytes(content)


def _open_regular(path: str | Path, *, follow_link: bool) -> int:
    """Return the descriptor of a regular file, opened for reading without blocking."""
    flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY | (0 if follow_link else os.O_NOFOLLOW)
    try:
        descriptor = os.open(path, flags)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise UnfitFile(errno.ELOOP, "is a symbolic link, not a regular file", str(path)) from None
        if error.errno == errno.ENXIO:
            raise UnfitFile(errno.ENXIO, "is a socket or a device, not a regular file", str(path)) from None
        raise
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        kind = _KINDS.get(stat.S_IFMT(mode), "something else")
        raise UnfitFile(errno.EINVAL, f"is {kind}, not a regular file", str(path))
    return descriptor
