"""Network interfaces, namespaces and faults, for tests that run as root in a separate kernel."""

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


def _run(command: str) -> None:
    done = subprocess.run(command.split(), capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stderr}"
