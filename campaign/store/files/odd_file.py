"""The error of a file that clearcap did not write."""

from campaign.errors import StoreError


class OddFile(StoreError):
    """What has the name of a file is not one that clearcap wrote: a pipe, a link, a folder, or too large.

    Parameters
    ----------
    where : str
        The store and the file.
    reason : str
        What it is instead.
    """

    def __init__(self, where: str, reason: str) -> None:
        super().__init__(f"{where} {reason}, so clearcap did not write it; move it away")
        self.where, self.reason = where, reason

    def __reduce__(self) -> tuple[type["OddFile"], tuple[str, str]]:
        return OddFile, (self.where, self.reason)
