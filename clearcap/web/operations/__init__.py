"""What people do with the service, one function each: the calls of the API and the pages are thin over them.

The types of their parameters say who may use them, and what is allowed, for FastAPI.
"""

import shutil
from pathlib import Path

from pydantic import BaseModel, ConfigDict
from starlette.datastructures import UploadFile


class Sent(BaseModel):
    """What a request sends; a key that its call does not know is refused."""

    model_config = ConfigDict(extra="forbid")


def keep_upload(sent: UploadFile, path: Path) -> None:
    """Write a file that was sent to a new file, for a job to read."""
    with path.open("xb") as file:
        shutil.copyfileobj(sent.file, file)
