"""The error for a file that was not written by clearcap."""

from campaign.errors import StoreError


class OddFile(StoreError):
    """An entry of the store was not written by clearcap: it is a pipe, a link or a folder, or too large.

    `where` names the store and the file, `reason` says what it is instead.
    """

    def __init__(self, where: str, reason: str) -> None:
        super().__init__(f"{where} {reason}, so clearcap did not write it; move it away")
        self.where, self.reason = where, reason

    def __reduce__(self) -> tuple[type["OddFile"], tuple[str, str]]:
        return OddFile, (self.where, self.reason)
