"""Workers that are processes connected by pipes, which start sooner than a scheduler and its workers."""

import signal
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, TypeVar

from campaign.cluster.workers import NoWorkerLeft, WorkerDied
from campaign.safe_path import current_folder_left_out
from campaign.waits import Wait

ENDS_WITHIN = 5.0  # s for an idle process to end after its pipe is closed

T = TypeVar("T")
Call = tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]


@contextmanager
def process_workers(count: int) -> Iterator["ProcessWorkers"]:
    """Yield up to ``count`` processes of this machine, each started when first needed; they end with the block."""
    workers = ProcessWorkers(count)
    try:
        yield workers
    finally:
        workers.close()


@dataclass
class _Process:
    """A spawned process, the pipes to and from it, and the future of the call that it runs."""

    process: SpawnProcess
    calls: "Connection[Any, Any]"
    answers: "Connection[Any, Any]"
    running: Future[Any] | None = None

    @property
    def name(self) -> str:
        """Name of the process in messages."""
        return f"process {self.process.pid}"

    def end(self) -> None:
        """End the process: at once if it is running a call, otherwise cleanly."""
        if self.running:
            self.process.kill()
        self.calls.close()
        # an idle process ends when its pipe is closed; one that does not is killed
        self.process.join(ENDS_WITHIN)
        self.process.kill()
        self.process.join()
        self.answers.close()


class ProcessWorkers:
    """Up to ``count`` processes; see `campaign.cluster.workers.Workers`. One that dies is replaced by another."""

    name = "this machine"

    def __init__(self, count: int) -> None:
        self._count = count
        self._processes: list[_Process] = []
        self._waiting: deque[Call] = deque()

    def count(self) -> int:
        """Return the number of processes available for calls."""
        return self._count

    def waits(self) -> list[Wait]:
        """Return nothing: processes are started when they are needed."""
        return []

    def expect(self, calls: int) -> None:
        """Do nothing: the number of processes is limited, and each is started when it is needed."""

    def submit(self, key: str, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Have the next free process call a function; ``key`` is not used, as there is no scheduler to show it."""
        if not self._count:
            raise NoWorkerLeft("every process is refused")
        future: Future[T] = Future()
        self._waiting.append((future, function, arguments))
        self._start_waiting()
        return future

    def next_finished(self, timeout: float | None = None) -> Future[Any] | None:
        """Wait for a call to finish and return it; start the next one in its process."""
        busy = {process.answers: process for process in self._processes if process.running}
        if self._waiting and not busy:
            raise NoWorkerLeft("every process is refused")
        for answers in wait(list(busy), None if timeout is None else max(timeout, 0.0)) if busy else ():
            process = busy[answers]  # type: ignore[index]  # these are the connections
            future, process.running = process.running, None
            assert future is not None
            self._finish(future, process)
            self._start_waiting()
            return future
        return None

    def refuse(self, call: Future[Any]) -> str:
        """End the process in which this call failed, and do not replace it; return its name."""
        worker = str(getattr(call.exception(), "worker", ""))
        for process in [process for process in self._processes if process.name == worker]:
            process.end()
            self._processes.remove(process)
            self._count -= 1
        return worker

    def cancel(self) -> None:
        """Cancel all calls in flight and end the processes that run them."""
        self._waiting.clear()
        for process in [process for process in self._processes if process.running]:
            process.end()
            self._processes.remove(process)

    def close(self) -> None:
        """End all processes."""
        self.cancel()
        for process in self._processes:
            process.end()
        self._processes.clear()

    def _start_waiting(self) -> None:
        """Give waiting calls to free processes, starting new processes up to the allowed number."""
        while self._waiting:
            free = next((process for process in self._processes if not process.running), None)
            if free is None:
                if len(self._processes) == self._count:
                    return
                free = _start()
                self._processes.append(free)
            future, function, arguments = self._waiting.popleft()
            free.running = future
            with suppress(BrokenPipeError):  # if it died while idle, `next_finished` notices by its other pipe
                free.calls.send((function, arguments))

    def _finish(self, future: Future[Any], process: _Process) -> None:
        """Finish a future with the answer of its process; drop a process that ended without an answer."""
        try:
            result, error = process.answers.recv()
        except (EOFError, OSError):
            process.end()
            self._processes.remove(process)
            future.set_exception(WorkerDied(f"{process.name}, which ended with exit status {process.process.exitcode}"))
            return
        if error is None:
            future.set_result(result)
        else:
            error.worker = process.name
            future.set_exception(error)


def _start() -> _Process:
    """Start a process that waits for calls."""
    context = get_context("spawn")
    calls_out, calls_in = context.Pipe(duplex=False)
    answers_out, answers_in = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(calls_out, answers_in), daemon=True)
    with current_folder_left_out():
        process.start()
    calls_out.close()  # the process has its own copy; with this one open, neither side would notice the other's end
    answers_in.close()
    return _Process(process, calls_in, answers_out)


def _serve(calls: "Connection[Any, Any]", answers: "Connection[Any, Any]") -> None:
    """Run calls one after the other until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that talks to the user
    while True:
        try:
            function, arguments = calls.recv()
        except EOFError:
            return
        try:
            answers.send((function(*arguments), None))
        except Exception as error:
            answers.send((None, error))
