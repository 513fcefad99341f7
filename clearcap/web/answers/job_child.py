"""The process that computes jobs one after the other; `clearcap.web.answers.job_process` starts it.

It reads pickled jobs from its standard input. It answers on its original standard output, with a line of JSON and the
number of bytes that this line announces. The server thus never unpickles data from a process that has read content from
strangers. The process ends as soon as its input is closed.
"""

import json
import math
import os
import pickle
import queue
import resource
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import asdict, is_dataclass
from typing import Any, BinaryIO

from campaign.errors import CampaignError
from campaign.json_values import json_values
from campaign.worker.limits import memory_limit
from clearcap.web.answers.job_limits import JobLimits

COMMAND = (sys.executable, "-P", "-c", "from clearcap.web.answers.job_child import main; main()")
Job = tuple[Callable[..., Any], tuple[Any, ...], JobLimits]


def main() -> None:
    """Compute jobs until standard input is closed."""
    for from_a_terminal in (signal.SIGINT, signal.SIGHUP):  # the server process handles them
        signal.signal(from_a_terminal, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a core dump could contain the secrets of a store
    requests, answers = _take_pipes()
    jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(requests, jobs), name="jobs", daemon=True).start()
    while True:
        _send(answers, *_answer(*jobs.get()))


def _take_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Return the pipes from and to the parent; give jobs an empty standard input and send their output to stderr."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return requests, answers


def _read(requests: BinaryIO, jobs: "queue.SimpleQueue[Job]") -> None:
    """Put each request into the queue; end the process when the input ends, even during a job."""
    try:
        while True:
            jobs.put(pickle.load(requests))
    except EOFError:
        os._exit(0)  # sys.exit would end this thread only
    except BaseException:  # an error in a thread does not end the process by itself
        traceback.print_exc()
        os._exit(1)


def _answer(job: Callable[..., Any], arguments: tuple[Any, ...], limits: JobLimits) -> tuple[dict[str, Any], bytes]:
    """Compute a job and return the head and the content of its answer."""
    try:
        with memory_limit(limits.memory_gib):
            _limit_processor_time(limits.processor_s)
            answer = job(*arguments)
            content = answer if isinstance(answer, bytes) else _json(answer)
    except MemoryError:
        return _failure("JobTooLarge", f"it takes more than {limits.memory_gib:g} GiB of memory; ask for less"), b""
    except CampaignError as error:
        return _failure(_kind(error), str(error), error), b""
    except Exception as error:
        from engine import EngineError  # already loaded if a job can have raised it

        if isinstance(error, EngineError):
            return _failure("SpecError", str(error), error), b""
        traceback.print_exc()
        message = f"it failed because of a bug in the program ({type(error).__name__}); the server's log says more"
        return _failure("JobFailed", message), b""
    finally:
        # lifted, so that the system does not end the process while it sends the answer
        resource.setrlimit(resource.RLIMIT_CPU, (resource.RLIM_INFINITY, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    if len(content) > limits.answer_mib * 2**20:
        return _failure("JobTooLarge", f"its answer has more than {limits.answer_mib:g} MiB; ask for less"), b""
    return {"size": len(content)}, content


def _limit_processor_time(seconds: float) -> None:
    """Let the system end this process after `seconds` more of processor time [s]."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    limit = math.ceil(used.ru_utime + used.ru_stime + seconds)
    resource.setrlimit(resource.RLIMIT_CPU, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


def _json(answer: Any) -> bytes:
    """Return plain data as JSON; numbers that are not finite become null."""
    return json.dumps(json_values(answer), ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def _kind(error: CampaignError) -> str:
    """Return the name of an error's nearest class that is defined in `campaign.errors`."""
    return next(base.__name__ for base in type(error).__mro__ if base.__module__ == CampaignError.__module__)


def _failure(kind: str, message: str, error: Exception | None = None) -> dict[str, Any]:
    """Return the head of an answer that reports an error."""
    faults = getattr(error, "faults", None)
    if faults is not None:
        faults = [asdict(fault) if is_dataclass(fault) and not isinstance(fault, type) else fault for fault in faults]
    return {"size": 0, "error": kind, "message": message, "faults": json_values(faults)}


def _send(answers: BinaryIO, head: dict[str, Any], content: bytes) -> None:
    """Send one answer."""
    try:
        answers.write(json.dumps(head, default=str).encode() + b"\n" + content)
        answers.flush()
    except BrokenPipeError:  # the server process has ended
        os._exit(1)
