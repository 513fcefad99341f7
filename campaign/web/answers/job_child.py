"""The process that computes jobs, one after the other, which `campaign.web.answers.job_process` starts.

It reads jobs from its standard input, each a pickle. It answers on what was its standard output with a line of JSON and
the bytes that this line announces: whoever asks needs not unpickle anything that a process sends which has read what
strangers wrote. When its input is closed, it ends at once.
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
from campaign.web.answers.job_limits import JobLimits
from campaign.worker.limits import memory_limit

COMMAND = (sys.executable, "-P", "-c", "from campaign.web.answers.job_child import main; main()")
Job = tuple[Callable[..., Any], tuple[Any, ...], JobLimits]


def main() -> None:
    """Compute jobs until standard input is closed."""
    for from_a_terminal in (signal.SIGINT, signal.SIGHUP):  # they are for the process that serves
        signal.signal(from_a_terminal, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # it may hold the secrets of a store
    requests, answers = _take_pipes()
    jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(requests, jobs), name="jobs", daemon=True).start()
    while True:
        _send(answers, *_answer(*jobs.get()))


def _take_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Return the pipes from and to the parent; what jobs read is empty, and what they print goes to standard error."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return requests, answers


def _read(requests: BinaryIO, jobs: "queue.SimpleQueue[Job]") -> None:
    """Put each request into the queue; end the process when there are no more, also amid a job."""
    try:
        while True:
            jobs.put(pickle.load(requests))
    except EOFError:
        os._exit(0)
    except BaseException:  # a thread's error ends nothing by itself
        traceback.print_exc()
        os._exit(1)


def _answer(job: Callable[..., Any], arguments: tuple[Any, ...], limits: JobLimits) -> tuple[dict[str, Any], bytes]:
    """Return the head and the content of the answer to a job."""
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
        from engine import EngineError  # by now it is loaded, if a job can have raised it

        if isinstance(error, EngineError):
            return _failure("SpecError", str(error), error), b""
        traceback.print_exc()
        message = f"it failed for a reason of the program's own ({type(error).__name__}); the server's log says more"
        return _failure("JobFailed", message), b""
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, (resource.RLIM_INFINITY, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    if len(content) > limits.answer_mib * 2**20:
        return _failure("JobTooLarge", f"its answer has more than {limits.answer_mib:g} MiB; ask for less"), b""
    return {"size": len(content)}, content


def _limit_processor_time(seconds: float) -> None:
    """Let the system end this process when it has taken so much more processor time."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    limit = math.ceil(used.ru_utime + used.ru_stime + seconds)
    resource.setrlimit(resource.RLIMIT_CPU, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


def _json(answer: Any) -> bytes:
    """Return plain data as JSON; a number that is not finite becomes null."""
    return json.dumps(json_values(answer), ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def _kind(error: CampaignError) -> str:
    """Return the name of an error's class among those of the campaign."""
    return next(base.__name__ for base in type(error).__mro__ if base.__module__ == CampaignError.__module__)


def _failure(kind: str, message: str, error: Exception | None = None) -> dict[str, Any]:
    """Return the head of an answer that is an error."""
    faults = getattr(error, "faults", None)
    if faults is not None:
        faults = [asdict(fault) if is_dataclass(fault) and not isinstance(fault, type) else fault for fault in faults]
    return {"size": 0, "error": kind, "message": message, "faults": json_values(faults)}


def _send(answers: BinaryIO, head: dict[str, Any], content: bytes) -> None:
    """Send one answer."""
    try:
        answers.write(json.dumps(head, default=str).encode() + b"\n" + content)
        answers.flush()
    except BrokenPipeError:  # the process that serves has ended
        os._exit(1)
