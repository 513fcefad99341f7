"""A server that speaks S3 over HTTP on loopback: ``python -m tests.campaign.s3_server [PORT [BUSY]]``.

One request at a time, so that a conditional PUT is decided like the real server's, and objects are kept in memory.
With BUSY = k, every k-th request is answered "slow down".
"""

import itertools
import sys

from moto.server import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import WSGIRequestHandler, make_server

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


def main(port=0, every=0):
    """Serve until killed; the port is the first line of output."""
    application = DomainDispatcherApplication(create_backend_app)
    server = make_server("127.0.0.1", port, busy(application, every) if every else application, request_handler=Quiet)
    print(server.server_port, flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
