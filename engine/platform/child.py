"""A child process that answers requests, for code that may crash, hang or take all memory.

The child runs this file as a program, which needs only the standard library, so that an error while it imports what
answers is reported like any other. It leads a session of its own: Ctrl-C reaches only the process that talks to the
user, and all that it starts is killed with it. It ends when its parent does.

Requests and messages are a line of JSON, with a size, followed by that many bytes. A request is answered by messages of
any kind, of which the last is ``done``, with what the function returned, or ``failed``, with the error that it raised.
"""

import ctypes
import json
import math
import os
import queue
import resource
import select
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, is_dataclass
from functools import partial
from importlib import import_module
from typing import Any, BinaryIO

LARGEST_HEAD = 2**20  # bytes of the line before a content
LARGEST_CONTENT = 2**31  # bytes
LOOK_INTERVAL = 2.0  # s for which a child is waited for at a time
DONE, FAILED = "done", "failed"
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux

Send = Callable[[str, bytes], None]


@dataclass(frozen=True)
class Limits:
    """What a request may take."""

    memory: float | None = None  # data of the process [bytes]
    processor_s: float | None = None


class ChildRaised(Exception):
    """The function that answers raised an error: the names of its classes, nearest first, its message and trace."""

    def __init__(self, content: bytes) -> None:
        report = json.loads(content)
        self.kinds: list[str] = report["kinds"]
        self.message: str = report["message"]
        self.trace: str = report["trace"]
        self.faults: Any = report["faults"]  # None, or the faults of an input as plain data
        super().__init__(f"{self.kinds[0]}: {self.message}" if self.message else self.kinds[0])


class ChildEnded(Exception):
    """The child ended without an answer; as a text: ``SIGKILL``, ``exit status 3``."""

    def __init__(self, status: int, was_silent: bool = False, last_line: str = "") -> None:
        self.status = status  # as of `subprocess.Popen.wait`
        self.was_silent = was_silent  # killed because it sent nothing for too long
        self.last_line = last_line  # that it printed, if that is known
        is_known = -status in set(signal.Signals)
        of_signal = signal.Signals(-status).name if is_known else f"signal {-status}"
        super().__init__(of_signal if status < 0 else f"exit status {status}")


def command(function: str) -> list[str]:
    """Return the command of a child that answers by a function, ``package.module:function``."""
    return [sys.executable, "-P", os.path.abspath(__file__), function]


def python_environment() -> dict[str, str]:
    """Return an environment in which Python can import the same modules as here, but not from the current folder."""
    path = filter(os.path.isabs, sys.path)
    return {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(path)}


def request_of(content: bytes, limits: Limits) -> bytes:
    """Return what is written to a child to ask it."""
    return json.dumps({"size": len(content), **asdict(limits)}).encode() + b"\n" + content


def head_of(line: bytes | bytearray) -> tuple[str, int]:
    """Return kind and size of a message; raise ValueError for a line that no child has sent."""
    head = json.loads(line)
    if not isinstance(head, dict) or not isinstance(head.get("kind"), str) or type(head.get("size")) is not int:
        raise ValueError("not the head of a message")
    if not 0 <= head["size"] <= LARGEST_CONTENT:
        raise ValueError("a message of such a size is none")
    return head["kind"], head["size"]


class Child:
    """A child that answers by a function; as a context it is killed at the end, with all that it has started.

    ``function`` is ``package.module:function``. It takes the content of a request and a function that sends a message
    ahead of the answer, and returns the content of the answer. A `quiet` child prints nothing; the last line that it
    would have printed is part of the report if it ends.
    """

    def __init__(self, function: str, environment: Mapping[str, str] | None = None, *, quiet: bool = False) -> None:
        self._received = bytearray()
        self._printed = tempfile.TemporaryFile() if quiet else None  # noqa: SIM115  # closed by `close`
        try:
            self._process = subprocess.Popen(
                command(function),
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._printed,
                env=python_environment() if environment is None else environment,
                start_new_session=True,
            )
        except BaseException:
            if self._printed is not None:
                self._printed.close()
            raise

    def __enter__(self) -> "Child":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Kill the child with all that it has started."""
        self._kill()
        self._process.__exit__(None, None, None)
        if self._printed is not None:
            self._printed.close()

    def answer(self, content: bytes, limits: Limits, silence_s: float) -> bytes:
        """Return the content of the answer; see `messages`."""
        *_, (_, answer) = self.messages(content, limits, lambda _: silence_s)
        return answer

    def messages(
        self, content: bytes, limits: Limits, silence_s: Callable[[str], float]
    ) -> Iterator[tuple[str, bytes]]:
        """Yield kind and content of the messages that answer a request, the last one ``done``.

        Raises ChildRaised if the function raised an error, and ChildEnded if the child ended, or was killed because it
        sent nothing for as long as it may be silent after a message of the last kind (empty: the request) [s], or took
        nothing of the request for so long.
        """
        kind, was_silent = "", False
        try:
            self._ask(request_of(content, limits), silence_s(kind))
            while kind != DONE:
                kind, received = self._message(silence_s(kind))
                if kind == FAILED:
                    raise ChildRaised(received)
                yield kind, received
            return
        except TimeoutError:
            was_silent = True
        except (EOFError, BrokenPipeError, ValueError):  # ValueError: something else has written to the pipe
            pass
        self._kill()
        raise ChildEnded(self._process.wait(), was_silent, self._last_line())

    def _ask(self, request: bytes, allowed: float) -> None:
        """Write a request; raise TimeoutError once the child has taken nothing of it for ``allowed`` seconds."""
        stdin, rest, silent = self._process.stdin, memoryview(request), 0.0
        assert stdin is not None
        os.set_blocking(stdin.fileno(), False)  # else one write waits until the child has taken all
        while rest:
            if (passed := silence(stdin.fileno(), select.POLLOUT)) is not None:
                silent += passed
                if silent > allowed:
                    raise TimeoutError
            else:
                silent = 0.0
                rest = rest[os.write(stdin.fileno(), rest) :]

    def _message(self, allowed: float) -> tuple[str, bytes]:
        """Return kind and content of the next message; raise TimeoutError after ``allowed`` seconds of silence."""
        received, head, silent = self._received, None, 0.0
        stdout = self._process.stdout
        assert stdout is not None
        while head is None or len(received) < head[1]:
            if head is None and (end := received.find(b"\n")) >= 0:
                head = head_of(received[:end])
                del received[: end + 1]
            elif (passed := silence(stdout.fileno())) is not None:
                silent += passed
                if silent > allowed:
                    raise TimeoutError
            else:
                silent = 0.0
                if not (chunk := os.read(stdout.fileno(), LARGEST_HEAD)):
                    raise EOFError
                received += chunk
                if head is None and len(received) > LARGEST_HEAD and b"\n" not in received:
                    raise ValueError("not the head of a message")
        content = bytes(received[: head[1]])
        del received[: head[1]]
        return head[0], content

    def _kill(self) -> None:
        if self._process.returncode is None:  # else its number may be another process's by now
            kill_session(self._process.pid)

    def _last_line(self) -> str:
        """Return the last line that a quiet child has printed."""
        if self._printed is None:
            return ""
        self._printed.seek(0)
        lines = self._printed.read()[-LARGEST_HEAD:].decode(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "")


def kill_session(pid: int) -> None:
    """Kill a child and all that it has started, if anything of it is left."""
    with suppress(ProcessLookupError, PermissionError):  # PermissionError: on macOS, for a zombie
        os.killpg(pid, signal.SIGKILL)


def silence(pipe: int, event: int = select.POLLIN) -> float | None:
    """Wait for something in a pipe, or for room in it; return the time if there is none for two seconds [s], else None.

    Only time while this process is awake counts, so that no child is blamed for the sleep of a laptop.
    """
    poller = select.poll()
    poller.register(pipe, event)
    return None if poller.poll(1e3 * LOOK_INTERVAL) else LOOK_INTERVAL


def within_own(limits: Limits) -> Limits:
    """Return limits for a child, none of them wider than what is left to this process, which may be a job itself."""
    used = resource.getrusage(resource.RUSAGE_SELF)

    def least(limit: float | None, kind: int, taken: float = 0.0) -> float | None:
        own = resource.getrlimit(kind)[0]
        left = None if own == resource.RLIM_INFINITY else max(own - taken, 1.0)
        return min((each for each in (limit, left) if each is not None), default=None)

    return Limits(
        least(limits.memory, resource.RLIMIT_DATA),
        least(limits.processor_s, resource.RLIMIT_CPU, used.ru_utime + used.ru_stime),
    )


@contextmanager
def limited(limits: Limits) -> Iterator[None]:
    """Limit this process in the block: further memory is a MemoryError, further processor time ends it by SIGXCPU."""
    wanted: dict[int, float] = {}
    if limits.memory is not None:
        wanted[resource.RLIMIT_DATA] = limits.memory
    if limits.processor_s is not None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        wanted[resource.RLIMIT_CPU] = used.ru_utime + used.ru_stime + limits.processor_s
    before = {kind: resource.getrlimit(kind) for kind in wanted}
    for kind, limit in wanted.items():
        hard = before[kind][1]
        resource.setrlimit(kind, (math.ceil(limit if hard == resource.RLIM_INFINITY else min(limit, hard)), hard))
    try:
        yield
    finally:
        for kind, both in before.items():
            resource.setrlimit(kind, both)


# -- in the child ------------------------------------------------------------------------------------------------------


def main() -> None:
    """Answer requests until standard input is closed."""
    for from_a_terminal in (signal.SIGINT, signal.SIGHUP):
        signal.signal(from_a_terminal, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a core dump could contain the secrets of a store
    with suppress(OSError, AttributeError):  # Linux only; elsewhere the end of the input ends it, unless it hangs
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    requests, answers = _take_pipes()
    waiting: queue.SimpleQueue[tuple[dict[str, Any], bytes]] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(requests, waiting), name="requests", daemon=True).start()
    send = partial(_send, answers)
    while True:
        send(*_answer(*waiting.get(), send))


def _take_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Return the pipes from and to the parent; what answers gets an empty input, and prints to standard error."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return requests, answers


def _receive(requests: BinaryIO, waiting: "queue.SimpleQueue[tuple[dict[str, Any], bytes]]") -> None:
    """Take requests ahead; end the process when the input ends, even amid an answer."""
    try:
        while line := requests.readline():
            head = json.loads(line)
            waiting.put((head, requests.read(head.pop("size"))))
        os._exit(0)  # sys.exit would end this thread only
    except BaseException:  # an error in a thread does not end the process by itself
        traceback.print_exc()
        os._exit(1)


def _answer(limits: dict[str, Any], request: bytes, send: Send) -> tuple[str, bytes]:
    """Return the last message to a request, sent once the limits are lifted."""
    try:
        with limited(Limits(**limits)):
            module, _, function = sys.argv[1].partition(":")
            return DONE, getattr(import_module(module), function)(request, send) or b""
    except Exception as error:
        report = {
            "kinds": [kind.__name__ for kind in type(error).__mro__],
            "message": str(error),
            "trace": traceback.format_exc(),
            "faults": getattr(error, "faults", None),
        }
        return FAILED, json.dumps(report, default=_plain).encode()


def _plain(value: Any) -> Any:
    """Return what JSON can hold in place of a value that it cannot."""
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else str(value)


def _send(answers: BinaryIO, kind: str, content: bytes) -> None:
    """Send one message."""
    try:
        answers.write(json.dumps({"kind": kind, "size": len(content)}).encode() + b"\n" + content)
        answers.flush()
    except BrokenPipeError:  # the parent has ended
        os._exit(1)


if __name__ == "__main__":
    main()
