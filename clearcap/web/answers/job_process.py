"""The server's handle to a process that computes jobs: start it, send it jobs, end it."""

import asyncio
import json
import os
import pickle
import re
import signal
from asyncio.subprocess import PIPE, Process
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from campaign import errors
from campaign.environment import numerical
from campaign.errors import CampaignError
from campaign.safe_path import python_environment
from clearcap.web.answers import job_limits
from clearcap.web.answers.job_child import COMMAND
from clearcap.web.answers.job_limits import JobFailed, JobLimits, JobPostponed, JobTooLarge

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
_LARGEST_HEAD = 2**20  # bytes of the line before an answer


def job_environment(environment: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the environment of a job process, with only the variables that paths, locales, stores and numbers need."""
    given = python_environment() if environment is None else environment
    passed = {name: value for name, value in given.items() if _PASSED_ON.fullmatch(name)}
    return passed | numerical(given) | _ONE_THREAD | _REUSED_MEMORY


class JobProcess:
    """A process that computes one job at a time; `start` starts it."""

    def __init__(self, process: Process) -> None:
        self._process = process

    @classmethod
    async def start(cls) -> "JobProcess":
        """Start a process as the leader of its own session, so that processes started by jobs can be ended with it."""
        process = await asyncio.create_subprocess_exec(
            *COMMAND, stdin=PIPE, stdout=PIPE, env=job_environment(), start_new_session=True, limit=_LARGEST_HEAD
        )
        return cls(process)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process is not known to have ended."""
        return self._process.returncode is None

    async def ask(self, job: Callable[..., Any], arguments: tuple[Any, ...], limits: JobLimits) -> bytes:
        """Compute a job and return its answer: bytes, or plain data as JSON.

        After `JobFailed`, TimeoutError or a cancellation the process must be ended. The job's own error is raised as
        CampaignError, whose ``faults`` is None or the faults of an input as data. Raises JobFailed if the process
        ended, JobTooLarge if the job exceeded its limits, JobPostponed if it waited too long.
        """
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        request = pickle.dumps((job, arguments, limits))
        try:
            async with asyncio.timeout(limits.wall_s):
                stdin.write(request)
                await stdin.drain()
                head = json.loads(await stdout.readuntil(b"\n"))
                content = await stdout.readexactly(head["size"])
        except TimeoutError:
            raise JobPostponed(
                f"it takes longer than {limits.wall_s:g} s, most of it waiting; try again later, or ask for less"
            ) from None
        except (asyncio.IncompleteReadError, ConnectionError):
            raise await self._why_ended(limits) from None
        if "error" in head:
            error: CampaignError = _error(head["error"])(head["message"])
            error.faults = head["faults"]  # type: ignore[attr-defined]
            raise error
        return content

    async def end(self) -> None:
        """Kill the process and the processes that its job has started."""
        if self.alive:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
        await self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()

    async def _why_ended(self, limits: JobLimits) -> JobFailed:
        """Return the error for a job whose process has ended."""
        status = await self._process.wait()
        if status == -signal.SIGXCPU:
            return JobTooLarge(f"it takes more than {limits.processor_s:g} s of processor time; ask for less")
        how = f"by signal {-status} ({signal.strsignal(-status)})" if status < 0 else f"with exit status {status}"
        return JobFailed(f"its process ended {how}; it was replaced, and the server's log may say more")


def _error(kind: str) -> type[CampaignError]:
    """Return the error class with a name; `JobFailed` if there is none."""
    found = getattr(job_limits, kind, None) or getattr(errors, kind, JobFailed)
    return found if isinstance(found, type) and issubclass(found, CampaignError) else JobFailed
