"""A TLS listener of zenoh under connections that come to nothing: how long a newcomer waits, and how many descriptors.

    python zenoh_accept.py [--connections 1113] [--seconds 12] [--hold] [--backlog 0]

Needs eclipse-zenoh and openssl. `--hold`: the connections are not closed. `--backlog N`: the listening socket gets
a queue of so many connections by a second listen(2). The attacker comes from 127.0.0.2, has no
certificate and sends no byte.
"""

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import zenoh

HERE, ATTACKER = "127.0.0.1", "127.0.0.2"
LONGEST_S = 180.0


def make_certificates(folder: Path) -> None:
    """An authority, and one certificate for both ends."""
    (folder / "san").write_text(f"subjectAltName=IP:{HERE}")
    key = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes"
    for command in (
        f"openssl req -x509 {key} -keyout ca.key -out ca.pem -subj /CN=ca -days 2",
        f"openssl req {key} -keyout key.pem -out cert.csr -subj /CN=peer",
        "openssl x509 -req -in cert.csr -CA ca.pem -CAkey ca.key -CAcreateserial -out cert.pem -days 2 -extfile san",
    ):
        subprocess.run(command.split(), cwd=folder, check=True, capture_output=True)


def configuration(folder: Path, role: str, port: int) -> zenoh.Config:
    """Mutual TLS; the newcomer tries until it is let in."""
    endpoints = f'["tls/{HERE}:{port}"]'
    tls = {
        "root_ca_certificate": folder / "ca.pem", "enable_mtls": "true",
        "listen_certificate": folder / "cert.pem", "listen_private_key": folder / "key.pem",
        "connect_certificate": folder / "cert.pem", "connect_private_key": folder / "key.pem",
    }  # fmt: skip
    text = ",".join(f'{key}:"{value}"' if isinstance(value, Path) else f"{key}:{value}" for key, value in tls.items())
    where = (
        f"listen:{{endpoints:{endpoints}}}"
        if role == "listen"
        else f"connect:{{endpoints:{endpoints},timeout_ms:1000}}"
    )
    mode = "router" if role == "listen" else "client"
    return zenoh.Config.from_json5(
        f'{{mode:"{mode}",{where},scouting:{{multicast:{{enabled:false}}}},transport:{{link:{{tls:{{{text}}}}}}}}}'
    )


def listen(folder: Path, port: int, backlog: int | None) -> None:
    """The process that is attacked."""
    with zenoh.open(configuration(folder, "listen", port)):
        if backlog is not None:
            shorten_queue(port, backlog)
        print("ready", flush=True)
        sys.stdin.read()


def shorten_queue(port: int, backlog: int) -> None:
    """Call listen(2) again on the library's socket, through a second descriptor of it."""
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError), socket.socket(fileno=os.dup(int(name))) as end:
            if end.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN) and end.getsockname()[1] == port:
                end.listen(backlog)


def newcomer_s(folder: Path, port: int) -> float:
    """Seconds until a session with a certificate is open."""
    began = time.monotonic()
    while time.monotonic() - began < LONGEST_S:
        with suppress(zenoh.ZError), zenoh.open(configuration(folder, "connect", port)):
            break
        time.sleep(0.05)
    return time.monotonic() - began


def attack(port: int, connections: int, seconds: float, hold: bool) -> list[socket.socket]:
    """Connect so often in so long, without waiting for any; those that are still open."""
    began, held = time.monotonic(), []
    for number in range(connections):
        end = socket.socket()
        end.bind((ATTACKER, 0))
        end.setblocking(False)
        end.connect_ex((HERE, port))
        held.append(end)
        if not hold and len(held) > 3:  # some 30 ms old
            held.pop(0).close()
        time.sleep(max(0.0, began + seconds * (number + 1) / connections - time.monotonic()))
    if not hold:
        for end in held:
            end.close()
    return held if hold else []


def main() -> None:
    """Measure before, at the end of the attack, and after."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--connections", type=int, default=1113)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--hold", action="store_true")
    parser.add_argument("--backlog", type=int)
    parser.add_argument("--listen", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.listen:
        listen(Path(options.listen[0]), int(options.listen[1]), options.backlog)
        return
    with tempfile.TemporaryDirectory() as name, socket.create_server((HERE, 0)) as probe:
        folder, port = Path(name), probe.getsockname()[1]
        probe.close()
        make_certificates(folder)
        command = [sys.executable, __file__, "--listen", name, str(port)]
        command += [] if options.backlog is None else ["--backlog", str(options.backlog)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as listener:
            assert listener.stdout
            listener.stdout.readline()

            def descriptors() -> int:
                return len(os.listdir(f"/proc/{listener.pid}/fd"))

            print(f"before: newcomer {newcomer_s(folder, port):.2f} s, {descriptors()} descriptors", flush=True)
            held = attack(port, options.connections, options.seconds, options.hold)
            print(f"attacked: {descriptors()} descriptors", flush=True)
            print(f"newcomer {newcomer_s(folder, port):.2f} s, {descriptors()} descriptors", flush=True)
            for end in held:
                end.close()
            time.sleep(5.0)
            print(f"5 s later: {descriptors()} descriptors")
            listener.kill()


if __name__ == "__main__":
    main()
