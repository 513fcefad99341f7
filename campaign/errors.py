"""What can go wrong in a campaign and is not a bug; every message is complete and made for the user."""


class CampaignError(Exception):
    """The work failed.

    Attributes
    ----------
    exit_code : int
        What the command exits with.
    """

    exit_code = 1


class SpecError(CampaignError):
    """The input is wrong: a campaign file, an option, a store that cannot be one. Nothing was written."""

    exit_code = 2


class StoreError(CampaignError):
    """The store cannot be reached, read or written."""

    exit_code = 4


class UnreachableError(CampaignError):
    """The scheduler or the cluster cannot be reached; what the store holds stays."""

    exit_code = 4
