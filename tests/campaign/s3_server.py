"""A server that speaks S3 over HTTP: ``python -m tests.campaign.s3_server [PORT [BUSY [PERCENT SEED]]]``.

It is on loopback, or where ``S3_HOST`` says. One request at a time, so that a conditional PUT is decided like the real
server's, and objects are kept in memory.
With BUSY = k, every k-th request is answered "slow down". With PERCENT, so many of a hundred requests go wrong, each in
a way drawn from SEED; the request ``GET /faults-of-the-test`` is answered with how many went wrong in which way.
"""

import itertools
import json
import os
import random
import sys
import time
from collections import Counter

from moto.server import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import WSGIRequestHandler, make_server
from werkzeug.test import run_wsgi_app

SLOW_DOWN = b"<Error><Code>SlowDown</Code><Message>Please reduce your request rate.</Message></Error>"


class Quiet(WSGIRequestHandler):
    """Logs nothing."""

    def log(self, type, message, *args):
        """Do nothing."""


def busy(application, every):
    """Return an application that answers every k-th request with 503."""
    requests = itertools.count(1)

    def answer(environ, start_response):
        if next(requests) % every:
            return application(environ, start_response)
        environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
        start_response("503 Slow Down", [("Content-Type", "application/xml"), ("Content-Length", str(len(SLOW_DOWN)))])
        return [SLOW_DOWN]

    return answer


def refused(status, code):
    """Return a fault: an error as the answer, and nothing is done."""

    def answer(application, environ, start_response):
        body = f"<Error><Code>{code}</Code><Message>{code}</Message></Error>".encode()
        start_response(status, [("Content-Type", "application/xml"), ("Content-Length", str(len(body)))])
        return [body]

    return answer


def cut(application, environ, start_response):
    """Drop the connection; nothing is done."""
    raise ConnectionAbortedError


def lost_answer(application, environ, start_response):
    """Do what is requested, and drop the connection in place of the answer."""
    run_wsgi_app(application, environ, buffered=True)
    raise ConnectionAbortedError


def half_body(application, environ, start_response):
    """Send half of what the answer announces."""
    body, status, headers = run_wsgi_app(application, environ, buffered=True)
    content = b"".join(body)
    start_response(status, list(headers))
    yield content[: len(content) // 2]
    raise ConnectionAbortedError


def late(application, environ, start_response):
    """Answer after two seconds."""
    time.sleep(2.0)
    return application(environ, start_response)


FAULTS = {
    "500": refused("500 Internal Server Error", "InternalError"),
    "503": refused("503 Service Unavailable", "ServiceUnavailable"),
    "slow down": refused("503 Slow Down", "SlowDown"),
    "cut": cut,
    "lost answer": lost_answer,
    "half body": half_body,
    "late": late,
}


def faulty(application, percent, seed):
    """Return an application of whose requests so many of a hundred go wrong."""
    chance, counts = random.Random(seed), Counter()

    def answer(environ, start_response):
        if environ["PATH_INFO"] == "/faults-of-the-test":
            start_response("200 OK", [("Content-Type", "application/json")])
            return [json.dumps(counts).encode()]
        counts["requests"] += 1
        if chance.random() >= percent / 100.0:
            return application(environ, start_response)
        fault = chance.choice(sorted(FAULTS))
        counts[fault] += 1
        if fault not in ("lost answer", "half body", "late"):
            environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
        return FAULTS[fault](application, environ, start_response)

    return answer


def main(port=0, every=0, percent=0, seed=0):
    """Serve until killed; the port is the first line of output."""
    application = DomainDispatcherApplication(create_backend_app)
    application = busy(application, every) if every else application
    application = faulty(application, percent, seed) if percent else application
    server = make_server(os.environ.get("S3_HOST", "127.0.0.1"), port, application, request_handler=Quiet)
    print(server.server_port, flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
