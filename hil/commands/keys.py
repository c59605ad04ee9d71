"""`uuv-hil keys`: make a small certificate authority, and a folder of certificates for each machine."""

import os

from hil.common.errors import ConfigError, MissingExtraError
from hil.common.options import host, integer, new_parser
from hil.common.schema import shortened
from hil.network.security import CA, CERTIFICATE, KEY

DAYS = integer(1, 36_500)  # a century
NAME_LENGTH = 64  # characters of a name in a certificate (RFC 5280, ub-common-name)
AUTHORITY = "authority"  # the folder that must not be copied to a vehicle
EXAMPLES = """\
DIR/authority/ can make certificates: keep it off the vehicles. DIR/NAME/ is all that the machine NAME needs; copy it
there, and name the folders of both machines in the scenario:

  [security]
  slave = "keys/uuv1"
  master = "keys/laptop"
  may_command = ["laptop"]

examples:
  uuv-hil keys init                                    once
  uuv-hil keys add uuv1 --host 192.168.3.116           a board, with each address and name of it that masters use
  uuv-hil keys add laptop
  uuv-hil keys add bench --host localhost              a vehicle that masters reach on its own machine or by a tunnel
"""


def main(arguments: list[str]) -> int:
    """Make an authority, or one machine's certificates; return the exit code."""
    parser = new_parser("keys", __doc__, EXAMPLES)
    parser.add_argument("--dir", metavar="FOLDER", default="keys", help="folder of all keys [%(default)s]")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    actions.add_parser("init", help="make the authority")
    add = actions.add_parser("add", help="make certificates for a machine")
    add.add_argument("name", metavar="NAME", help="name of the machine in may_command and may_listen")
    add.add_argument(
        "--host",
        metavar="ADDRESS",
        type=host,
        action="append",
        default=[],
        help="an address or name by which others connect to it; repeatable",
    )
    add.add_argument("--days", metavar="N", type=DAYS, default=730, help="days of validity from today [%(default)s]")
    options = parser.parse_args(arguments)
    try:
        import cryptography  # noqa: F401 - reported here, before anything is written
    except ImportError:
        raise MissingExtraError("certificates need cryptography: pip install 'uuv-hil[security]'") from None
    if options.action == "init":
        print(f"{init(options.dir)}/: the authority; next: uuv-hil keys add NAME --host ADDRESS")
    else:
        folder = add_machine(options.dir, options.name, options.host, options.days)
        print(f"{folder}/: copy it to {options.name}")
    return 0


def init(directory: str) -> str:
    """Make an authority in `directory`; return its folder. Raises ConfigError when there is one already."""
    from hil.network.certificates import new_authority

    authority = new_authority()
    folder = _new_folder(directory, AUTHORITY, "a new one would make all existing certificates invalid")
    _write(folder, CA, authority.certificate)
    _write(folder, KEY, authority.key)
    return folder


def add_machine(directory: str, name: str, hosts: list[str], days: int = 730) -> str:
    """Make certificates for a machine to which others connect by its name or one of `hosts`; return its folder.

    Only the host "localhost" adds the addresses of this machine itself: at the end of a tunnel, where every machine is
    localhost, a certificate with it passes for the vehicle.

    Raises ConfigError when there is no authority, the name cannot be one, or the machine has certificates.
    """
    from hil.network.certificates import Pair, new_machine

    is_plain = 0 < len(name) <= NAME_LENGTH and all(c.isascii() and (c.isalnum() or c in "-_.") for c in name)
    if not is_plain or name in (".", "..", AUTHORITY):
        rule = f"1 to {NAME_LENGTH} letters, digits, - _ . only, and not {AUTHORITY!r}"
        raise ConfigError(f"{shortened(name)} cannot be a machine's name: {rule}")
    authority = Pair(_read(directory, CA), _read(directory, KEY))
    here = ["127.0.0.1", "::1"] if "localhost" in hosts else []
    machine = new_machine(authority, name, list(dict.fromkeys([name, *hosts, *here])), days)
    folder = _new_folder(directory, name, "remove it first to replace it")
    _write(folder, CA, authority.certificate)
    _write(folder, CERTIFICATE, machine.certificate)
    _write(folder, KEY, machine.key)
    return folder


def _new_folder(directory: str, name: str, reason: str) -> str:
    path = os.path.join(directory, name)
    try:
        os.makedirs(directory, exist_ok=True)
        os.mkdir(path, 0o700)
    except FileExistsError:
        raise ConfigError(f"{path}: exists already; {reason}") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be created: {error.strerror}") from None
    return path


def _read(directory: str, name: str) -> bytes:
    path = os.path.join(directory, AUTHORITY, name)
    try:
        with open(path, "rb") as file:
            return file.read()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; `uuv-hil keys init` makes the authority") from None


def _write(folder: str, name: str, data: bytes) -> None:
    """Write a new file that only its owner may read."""
    descriptor = os.open(os.path.join(folder, name), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)
