"""What others send to the port: too much, too slowly, without an end, two requests that look like one."""

import socket
from contextlib import ExitStack

import psutil
import pytest

from clearcap.web.access import Role
from clearcap.web.server import LARGEST_HEAD, SEND_BUFFER
from clearcap.web.settings import Limits, Settings
from tests.clearcap.web.running import PATIENCE, HeldClock, exchange, in_a_thread, taken
from tests.each import each
from tests.until import until

pytestmark = pytest.mark.processes

LIMITS = Limits(body=20_000, body_seconds=0.5, head_seconds=0.5, read_seconds=2.0, connections=100)
CALL = "POST /api/v1/checks/mechanism HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
STEP = 0.1  # s, by which time passes
SOME = 2 * SEND_BUFFER  # bytes: of fewer the server may not hear
HIDDEN = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"


@pytest.fixture(scope="module")
def listening(tmp_path_factory):
    """Return the port of a server with narrow limits whose time stands, how a user's call begins, and its clock."""
    folder = tmp_path_factory.mktemp("hostile")
    settings = Settings(str(folder / "runs"), folder / "data", processes=0, limits=LIMITS)
    clock = HeldClock()
    with in_a_thread(settings, clock) as (service, port):
        _, secret = service.tokens.add("admin", "test", Role.ADMIN, 3600.0)
        yield port, f"{CALL}Authorization: Bearer {secret}\r\n".encode(), clock


@pytest.fixture
def port(listening):
    """Return the port."""
    return listening[0]


@pytest.fixture
def call(listening):
    """Return how a user's call begins."""
    return listening[1]


@pytest.fixture
def clock(listening):
    """Return the clock of the server."""
    return listening[2]


@pytest.fixture(autouse=True)
def goes_on(port):
    """Check that the server answers after each test."""
    yield
    answer = exchange(port, HIDDEN.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
    assert answer.startswith(b"HTTP/1.1 200"), answer


def _status(answer):
    return int(answer.split(b" ")[1]) if answer else None


def _endless(piece):
    while True:
        yield piece


def test_large_body(port, call):
    """One that says how large it is, is refused before it is sent."""
    assert _status(exchange(port, call, b"Content-Length: 20001\r\n\r\n")) == 413


def test_endless_body(port, call):
    chunk = b"%x\r\n%s\r\n" % (5000, b"x" * 5000)
    head = call + b"Transfer-Encoding: chunked\r\n\r\n"
    assert _status(exchange(port, head, *(chunk for _ in range(100)))) == 413


def test_slow_body(port, call, clock):
    """One that never ends, and one of which a byte arrives now and then."""
    head = call + b"Content-Length: 1000\r\n\r\n"
    assert _status(exchange(port, head, b"{", clock=clock, step=STEP)) == 408
    assert _status(exchange(port, head, *[b" "] * 10, clock=clock, step=STEP)) == 408


@pytest.mark.parametrize("head", [b"", b"GET /healthz HT", b"GET /healthz HTTP/1.1\r\nHost: local", b"\r\n\r\n"])
def test_slow_head(port, head, clock):
    """A connection that does not finish its head is closed."""
    assert _status(exchange(port, head, clock=clock, step=STEP)) == 408


def test_slow_head_by_drips(port, clock):
    """No piece of a head gives time for the next."""
    begin, pieces = clock.now, [b"X-A: b\r\n"] * 100
    head = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n"
    assert _status(exchange(port, head, *pieces, clock=clock, step=STEP)) == 408
    assert clock.now - begin < 2 * LIMITS.head_seconds


def test_endless_second_head(port, call):
    """The head of a request that is sent while the one before is at work may not be larger than others."""
    head = call + b"Content-Length: 1000\r\n\r\n" + b" " * 1000  # its body takes a job
    pieces = [HIDDEN[:-2] + b"X-A: ", *[b"b" * 8000] * (10 * LARGEST_HEAD // 8000)]
    assert b'{"status":"ok"}' not in exchange(port, head + pieces[0], *pieces[1:])


def test_endless_trailers(port, clock):
    """What a stranger sends behind his body is not kept, and ends with the time that a body may take."""
    head = b"POST /login HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n"
    head += b"Content-Type: application/x-www-form-urlencoded\r\n\r\n0\r\n"
    trailers = (b"X-A: " + b"b" * 1000 + b"\r\n") * 60
    before = psutil.Process().memory_info().rss
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as connection:
        connection.sendall(head)
        for _ in range(500):
            connection.sendall(trailers)
        assert _status(taken(connection, clock, STEP)) == 408
    assert psutil.Process().memory_info().rss - before < 15 << 20  # of 30 MB


def test_trailers_are_no_headers(port):
    """They cannot say whose request it is, and the request before them is answered."""
    head = b"POST /login HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\nConnection: close\r\n"
    head += b"Content-Type: application/x-www-form-urlencoded\r\n\r\n"
    body = b"name=x&password=y"
    assert _status(exchange(port, head, b"%x\r\n%s\r\n0\r\nHost: evil\r\n\r\n" % (len(body), body))) == 401


def test_answers_that_nobody_reads(port, clock):
    """A connection that takes nothing of its answers is closed."""
    ask = b"GET /api/v1/openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", port))
        own = connection.getsockname()
        connection.sendall(ask * 400)
        until(lambda: clock.move(LIMITS.read_seconds) or own not in _connected(port), "it is closed")


def test_answer_that_is_read_slowly(port, clock):
    """Whoever takes some of an answer between any two looks at him has it whole."""
    ask = b"GET /api/v1/openapi.json HTTP/1.1\r\nHost: localhost\r\n"
    whole = exchange(port, ask + b"Connection: close\r\n\r\n").partition(b"\r\n\r\n")[2]
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)  # little waits here, unseen by the server
        connection.settimeout(PATIENCE)
        connection.connect(("127.0.0.1", port))
        connection.sendall((ask + b"\r\n") * 19 + ask + b"Connection: close\r\n\r\n")
        answers, reader = b"", connection.makefile("rb")
        while more := reader.read(SOME):
            answers += more
            clock.move(LIMITS.read_seconds)
    assert answers.endswith(whole)
    assert answers.count(whole) == 20


def _connected(port):
    """Return the addresses that are connected to a port, as the server sees it."""
    return {c.raddr for c in psutil.Process().net_connections("tcp4") if c.laddr.port == port and c.raddr}


def test_slow_second_head(port, clock):
    """A connection that asked once is held to the same afterwards, also with blank lines only."""
    for piece in (b"GET /heal", b"\r\n"):
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as connection:
            connection.sendall(HIDDEN)
            answer = b""
            while not answer.endswith(b'{"status":"ok"}'):
                answer += connection.recv(1 << 16)
            connection.sendall(piece)
            assert _status(taken(connection, clock, STEP)) == 408


def test_endless_head(port):
    for piece in (b"X-A: " + b"b" * 8000 + b"\r\n", b"b" * 8000):
        start = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nX-A: "
        pieces = [piece] * (10 * LARGEST_HEAD // len(piece))
        assert _status(exchange(port, start, *pieces)) in (431, None)  # none: it was closed before it could be read


@each(
    "headers",
    [
        "Content-Length: 5\r\nTransfer-Encoding: chunked",
        "Transfer-Encoding: chunked\r\nContent-Length: 5",
        "Content-Length: 5\r\nContent-Length: 6",
        "Content-Length: +5",
        "Content-Length: 5, 5",
        "Content-Length : 5",
        "Transfer-Encoding: xchunked",
        "Transfer-Encoding: chunked, identity",
        "Transfer-Encoding : chunked",
        "X: a\r\n Content-Length: 5",
        "X: a\0b",
        "X: a\rContent-Length: 5",
    ],
)
def test_request_in_a_request(port, call, headers):
    """What one reader takes for a body and another for a second request is refused; the second is not answered."""
    answer = exchange(port, call + headers.encode() + b"\r\n\r\n0\r\n\r\n" + HIDDEN)
    assert b'{"status":"ok"}' not in answer, answer
    assert 400 <= _status(answer) < 500


@pytest.mark.parametrize("line", ["GET / HTTP/9.9", "GARBAGE", "G\0T / HTTP/1.1", "\x16\x03\x01\x02\x00"])
def test_garbage(port, line, clock):
    piece = line.encode("latin-1") + b"\r\nHost: localhost\r\n\r\n"
    assert _status(exchange(port, piece, clock=clock, step=STEP)) in (400, 408, 505)


@each("method", ["HEAD", "OPTIONS", "TRACE", "CONNECT", "PROPFIND"])
@each("path", ["/healthz", "/campaigns", "/api/v1/campaigns", "/static/pages.css", "*", "/%00"])
def test_other_methods(port, method, path):
    """They have no answer but a refusal, or a head without a body."""
    head = f"{method} {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode()
    answer = exchange(port, head)
    assert 200 <= _status(answer) < 500, answer
    assert b"TRACE" not in answer
    assert method != "HEAD" or answer.endswith(b"\r\n\r\n")


@pytest.mark.parametrize("text", ['{"text":' * 3000, "[" * 19_000, '{"text": ' + "9" * 19_000 + "}"])
def test_deep_json(port, call, text):
    """It is no reason to end."""
    head = call + f"Content-Length: {len(text)}\r\nConnection: close\r\n\r\n".encode()
    assert _status(exchange(port, head + text.encode())) in (400, 413, 422)


def test_silent_connections_do_not_keep_others_out(port, clock):
    """A crowd of connections that say nothing is gone after the time that a head may take."""
    crowd = [socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) for _ in range(50)]
    close = HIDDEN.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")
    assert _status(exchange(port, close)) == 200
    for connection in crowd:
        assert _status(taken(connection, clock, STEP)) == 408
        connection.close()


def test_connections_of_one_address(port, call):
    """One too many ends the oldest that asks nothing; where all are at work, the new one is refused."""
    close = HIDDEN.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")
    until(lambda: not _connected(port), "those of the test before are gone")  # they would be the oldest
    with ExitStack() as stack:

        def connected(begun):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=PATIENCE))
            connection.sendall(begun)
            return connection

        crowd = [connected(b"GET /healthz HT") for _ in range(LIMITS.connections + 20)]
        assert _status(exchange(port, close)) == 200
        for number in range(21):
            assert _status(taken(crowd[number])) == 408, number
        for connection in crowd[21:]:
            connection.sendall(b"TP/1.1\r\nHost: localhost\r\n\r\n")
            assert connection.recv(1000).startswith(b"HTTP/1.1 200")
    until(lambda: not _connected(port), "all are gone")
    with ExitStack() as stack:
        for _ in range(LIMITS.connections):
            at_work = connected(call + b"Content-Length: 1000\r\nExpect: 100-continue\r\n\r\n")
            assert at_work.recv(1000).startswith(b"HTTP/1.1 100")
        assert _status(exchange(port, b"")) == 503
    until(lambda: not _connected(port), "all are gone")
