"""Hosts of a network of their own, made of Linux network namespaces: nothing of it is seen from outside."""

import os
import subprocess
from contextlib import ExitStack, contextmanager


def ip(*words):
    """Run ``ip``."""
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


@contextmanager
def namespace(name):
    """Make a network namespace and remove it, whatever happens."""
    ip("netns", "add", name)
    try:
        ip("-n", name, "link", "set", "lo", "up")
        yield name
    finally:
        subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)


@contextmanager
def network(names):
    """Make a host for each name on one bridge.

    Yields
    ------
    dict
        For each name its namespace and its address.
    """
    tag = f"cc{os.getpid()}"
    with ExitStack() as stack:
        switch = stack.enter_context(namespace(f"{tag}-switch"))
        ip("-n", switch, "link", "add", "bridge", "type", "bridge")
        ip("-n", switch, "link", "set", "bridge", "up")
        hosts = {}
        for number, name in enumerate(names, start=1):
            host = stack.enter_context(namespace(f"{tag}-{name}"))
            port = f"port{number}"
            ip("-n", switch, "link", "add", port, "type", "veth", "peer", "name", "eth0", "netns", host)
            ip("-n", switch, "link", "set", port, "master", "bridge", "up")
            ip("-n", host, "address", "add", f"10.77.0.{number}/24", "dev", "eth0")
            ip("-n", host, "link", "set", "eth0", "up")
            ip("-n", host, "route", "add", "default", "dev", "eth0")  # by it dask finds its own address
            hosts[name] = (host, f"10.77.0.{number}")
        yield hosts


@contextmanager
def cut_off(host, address):
    """Drop what goes to and from a host, silently, as a switch that has lost its way does."""
    switch, port = f"{host.split('-')[0]}-switch", f"port{address.rpartition('.')[2]}"
    ip("-n", switch, "link", "set", port, "nomaster")
    try:
        yield
    finally:
        ip("-n", switch, "link", "set", port, "master", "bridge")


@contextmanager
def unanswered(host, address):
    """Drop what a host sends to an address, whose owner hears nothing of it any more; all else is as before."""
    route = ("blackhole", f"{address}/32")
    ip("-n", host, "route", "add", *route)
    try:
        yield
    finally:
        ip("-n", host, "route", "del", *route)


def inside(host):
    """Return the words that run a command on a host."""
    return ("nsenter", f"--net=/run/netns/{host}")  # unlike ip netns exec it leaves /sys as it is
