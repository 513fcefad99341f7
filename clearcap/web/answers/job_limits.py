"""Resource limits of a job, and the errors of jobs that end without an answer."""

from dataclasses import dataclass

from campaign.errors import CampaignError


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
    """A job cannot be computed now: no process could be started, or it waited too long for the machine or the store."""
