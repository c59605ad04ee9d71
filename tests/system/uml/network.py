"""Network interfaces, namespaces and faults, for tests that run as root in a separate kernel."""

import ctypes
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager


def ip(arguments: str) -> None:
    """Run `ip` of iproute2, which reports errors."""
    _run(f"ip {arguments}")


@contextmanager
def interface(name: str, kind: str) -> Iterator[None]:
    """Provide an interface that is up, as `ip link add` takes it: "vcan", or "vxcan peer name b"."""
    ip(f"link add {name} type {kind}")
    try:
        ip(f"link set {name} up")
        yield
    finally:
        ip(f"link delete {name}")


@contextmanager
def shaped(device: str, how: str, namespace: str = "") -> Iterator[None]:
    """Apply `tc qdisc` arguments such as "netem delay 20ms loss 5%" to all packets sent by `device`."""
    tc = f"ip netns exec {namespace} tc" if namespace else "tc"
    _run(f"{tc} qdisc add dev {device} root {how}")
    try:
        yield
    finally:
        _run(f"{tc} qdisc delete dev {device} root")


@contextmanager
def namespace(name: str) -> Iterator[None]:
    """Make a network namespace, which acts as another computer."""
    ip(f"netns add {name}")
    try:
        yield
    finally:
        ip(f"netns delete {name}")


@contextmanager
def within(name: str) -> Iterator[None]:
    """Let this thread open its sockets in that namespace."""
    with open("/proc/thread-self/ns/net") as home, open(f"/run/netns/{name}") as away:
        _enter(away.fileno())
        try:
            yield
        finally:
            _enter(home.fileno())


def _enter(descriptor: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)  # os.setns is Python 3.12's
    if libc.setns(descriptor, 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def _run(command: str) -> None:
    done = subprocess.run(command.split(), capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stderr}"
