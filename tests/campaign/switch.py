"""The way to a server, which can be cut: connections are then refused, or taken and never answered."""

import socket
import threading
from contextlib import suppress


class Switch:
    """Leads a port of loopback to another one.

    Parameters
    ----------
    target : int
        Port of the server.

    Attributes
    ----------
    port : int
        Where it is to be asked.
    """

    def __init__(self, target):
        self._target, self._ends, self._lock = target, set(), threading.Lock()
        self._listening, self._is_silent = None, False
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            self.port = found.getsockname()[1]
        self.lead()

    def lead(self):
        """Lead to the server again."""
        self._set(is_silent=False)

    def refuse(self):
        """Refuse connections, as where nothing listens."""
        self._hang_up()
        if self._listening is not None:
            _close(self._listening)
            self._listening = None

    def keep_silent(self):
        """Take connections and say nothing, as an overloaded server or a firewall does."""
        self._set(is_silent=True)

    def _set(self, *, is_silent):
        self._is_silent = is_silent
        self._hang_up()
        if self._listening is None:
            self._listening = socket.create_server(("127.0.0.1", self.port), backlog=200)
            threading.Thread(target=self._accept, args=(self._listening,), daemon=True).start()

    def _hang_up(self):
        with self._lock:
            ends, self._ends = self._ends, set()
        for end in ends:
            _close(end)

    def _accept(self, listening):
        with suppress(OSError):  # it is closed
            while True:
                here, _ = listening.accept()
                pair = [here]
                if not self._is_silent:
                    pair.append(socket.create_connection(("127.0.0.1", self._target)))
                    for one, other in (pair, pair[::-1]):
                        threading.Thread(target=_carry, args=(one, other), daemon=True).start()
                with self._lock:
                    self._ends.update(pair)


def _carry(one, other):
    """Send to the other end what comes from one, until one of them is closed."""
    with suppress(OSError):
        while data := one.recv(1 << 16):
            other.sendall(data)
    for end in (one, other):
        _close(end)


def _close(end):
    with suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
    end.close()
