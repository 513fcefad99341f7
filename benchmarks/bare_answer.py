"""A minimal HTTP answer, one line of text by Starlette under uvicorn: the reference for load measurements."""

import sys

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route


async def bare_answer(_: Request) -> PlainTextResponse:
    """Answer one line."""
    return PlainTextResponse("ok")


if __name__ == "__main__":
    uvicorn.run(Starlette(routes=[Route("/", bare_answer)]), port=int(sys.argv[1]), log_config=None, access_log=False)
