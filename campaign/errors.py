"""Errors of a campaign that are no bugs; every message is complete and written for the user."""


class CampaignError(Exception):
    """The work failed.

    Attributes
    ----------
    exit_code : int
        Exit status of the command.
    """

    exit_code = 1


class SpecError(CampaignError):
    """The input is wrong: a campaign file, an option, the address of a store. Nothing was written."""

    exit_code = 2


class StoreError(CampaignError):
    """The store cannot be reached, read or written."""

    exit_code = 4


class UnreachableError(CampaignError):
    """The scheduler or the cluster cannot be reached; the store keeps what it holds."""

    exit_code = 4
