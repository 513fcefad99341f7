"""What a job may take, and how it ends if it takes more."""

from dataclasses import dataclass

from campaign.errors import CampaignError


@dataclass(frozen=True)
class JobLimits:
    """What one job may take.

    Attributes
    ----------
    processor_s : float
        Processor time [s].
    wall_s : float
        Time from when it begins [s].
    memory_gib : float
        Memory of its process [GiB], mapped files apart.
    answer_mib : float
        Size of its answer [MiB].
    """

    processor_s: float = 60.0
    wall_s: float = 180.0
    memory_gib: float = 4.0
    answer_mib: float = 64.0


class JobFailed(CampaignError):
    """A job ended without an answer, for a reason of the server's own: its process ended, or it has a bug."""


class JobTooLarge(JobFailed):
    """A job needs more processor time or memory, or a larger answer, than it may have: its user asks for too much."""


class JobPostponed(JobFailed):
    """A job cannot be computed now: no process could be started, or it waits too long for the machine or the store."""
