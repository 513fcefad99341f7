"""What people do with the service, one function each: the calls of the API and the pages are thin over them.

The types of their parameters say who may use them, and what is allowed, for FastAPI.
"""

from pydantic import BaseModel, ConfigDict


class Sent(BaseModel):
    """What a request sends; a key that its call does not know is refused."""

    model_config = ConfigDict(extra="forbid")
