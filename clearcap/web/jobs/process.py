"""A process that computes jobs one after the other, and the server's handle to it: start it, send it jobs, end it.

Jobs are pickled for it. The server never unpickles what comes back: the process has read content from strangers.
"""

import asyncio
import json
import logging
import pickle
import re
import signal
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from campaign import errors
from campaign.errors import CampaignError, SpecError, error_named
from campaign.json_values import json_values
from campaign.processes import numerical
from engine.platform import child


@dataclass(frozen=True)
class JobLimits:
    """Resource limits of one job."""

    processor_s: float = 60.0
    wall_s: float = 180.0  # since its start
    memory_gib: float = 4.0  # of its process, without mapped files
    answer_mib: float = 64.0


class JobFailed(CampaignError):
    """A job ended without an answer for an internal reason: its process ended, or it has a bug."""


class JobTooLarge(JobFailed):
    """A job exceeded its processor time, memory or answer size, because its user asked for too much."""


class JobPostponed(JobFailed):
    """A job cannot be computed now: its process could not be started or was killed, or it waited too long."""


# Signals by which users and machines without memory end a process; others, such as SIGSEGV, are its own faults.
ENDED_BY_OTHERS = tuple(-number for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP))


# Environment variables that a job process needs; it does not get the others, some of which are secrets of the service.
_PASSED_ON = re.compile(
    r"PATH|HOME|USER|LANG|LC_.*|TZ|TMPDIR|LD_LIBRARY_PATH|PYTHON.*|VIRTUAL_ENV|XDG_CACHE_HOME|NUMBA_.*|MPLBACKEND"
    r"|CLEARCAP_TEMPORARY_CACHE|(HTTPS?|NO|ALL)_PROXY|SSL_CERT_(FILE|DIR)|AWS_.*|FSSPEC_.*|GOOGLE_APPLICATION_CREDENTIALS"
    r"|AZURE_STORAGE_.*",
    re.IGNORECASE,
)
# These settings let arrays of a million numbers reuse memory that was just freed. With fresh pages for each array, the
# default of glibc, a question about a million samples takes half as long again.
_REUSED_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(256 << 20), "MALLOC_TRIM_THRESHOLD_": str(512 << 20)}
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
logger = logging.getLogger(__name__)


def job_environment(environment: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the environment of a job process, with only the variables that paths, locales, stores and numbers need."""
    given = child.python_environment() if environment is None else environment
    passed = {name: value for name, value in given.items() if _PASSED_ON.fullmatch(name)}
    return passed | numerical(given) | _ONE_THREAD | _REUSED_MEMORY


def compute(request: bytes, _send: child.Send) -> bytes:
    """Compute a job, in its process; return its bytes, or its plain data as JSON without NaN."""
    job, arguments, answer_mib = pickle.loads(request)
    answer = job(*arguments)
    if not isinstance(answer, bytes):
        answer = json.dumps(json_values(answer), ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    if len(answer) > answer_mib * 2**20:
        raise JobTooLarge(f"its answer has more than {answer_mib:g} MiB; ask for less")
    return answer


class JobProcess:
    """A process that computes one job at a time; `start` starts it."""

    def __init__(self, process: Process) -> None:
        self._process = process

    @classmethod
    async def start(cls) -> "JobProcess":
        """Start a process."""
        process = await asyncio.create_subprocess_exec(
            *child.command(f"{__name__}:{compute.__name__}"),
            stdin=PIPE,
            stdout=PIPE,
            env=job_environment(),
            start_new_session=True,
            limit=child.LARGEST_HEAD,
        )
        return cls(process)

    @property
    def alive(self) -> bool:
        """Whether the process is not known to have ended."""
        return self._process.returncode is None

    async def ask(self, job: Callable[..., Any], arguments: tuple[Any, ...], limits: JobLimits) -> bytes:
        """Return what `compute` returns for a job; after `JobFailed` or a cancellation the process must be ended."""
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        request = pickle.dumps((job, arguments, limits.answer_mib))
        try:
            async with asyncio.timeout(limits.wall_s):
                stdin.write(child.request_of(request, child.Limits(limits.memory_gib * 2**30, limits.processor_s)))
                await stdin.drain()
                kind, size = child.head_of(await stdout.readuntil(b"\n"))
                content = await stdout.readexactly(size)
        except TimeoutError:
            raise JobPostponed(
                f"it takes longer than {limits.wall_s:g} s, most of it waiting; try again later, or ask for less"
            ) from None
        except (EOFError, ConnectionError, ValueError, asyncio.LimitOverrunError):  # ended, or spoiled its answers
            child.kill_session(self._process.pid)
            ended = child.ChildEnded(await self._process.wait())
            if ended.status == -signal.SIGXCPU:
                words = f"it takes more than {limits.processor_s:g} s of processor time; ask for less"
                raise JobTooLarge(words) from None
            if ended.status in ENDED_BY_OTHERS:
                words = f"its process was ended from outside ({ended}), as by a machine without memory; try again later"
                raise JobPostponed(words) from None
            words = f"its process ended ({ended}); it was replaced, and the server's log may say more"
            raise JobFailed(words) from None
        if kind == child.FAILED:
            raise _error(child.ChildRaised(content), limits)
        return content

    async def end(self) -> None:
        """Kill the process and the processes that its job has started."""
        if self.alive:
            child.kill_session(self._process.pid)
        await self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()


def _error(raised: child.ChildRaised, limits: JobLimits) -> CampaignError:
    """Return the error for a job that raised one."""
    if "MemoryError" in raised.kinds:
        return JobTooLarge(f"it takes more than {limits.memory_gib:g} GiB of memory; ask for less")
    kind = SpecError if "EngineError" in raised.kinds else error_named(raised.kinds, sys.modules[__name__], errors)
    if kind is None:
        logger.error("a job has failed:\n%s", raised.trace)
        return JobFailed(f"it failed because of a bug in the program ({raised.kinds[0]}); the server's log says more")
    error = kind(raised.message)
    error.faults = json_values(raised.faults)  # type: ignore[attr-defined]
    return error
