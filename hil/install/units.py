"""Generate the files that make the slave a service of the board: systemd units, udev rules and others."""

import os
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from boards import FOLDER, Board
from boards.tree import Tree
from hil.common.children import module_command
from hil.common.clock import LOOP_PRIORITY
from hil.common.errors import ConfigError
from hil.common.schema import preset_folder
from hil.install.companions import KINDS, Address, Companion, slave_addresses
from hil.links.address import parse_address
from hil.scenario.config import Scenario

UNITS = "/etc/systemd/system/"
UNIT, CAN_UNIT, MODULE_UNIT, FIREWALL_UNIT = (
    f"{UNITS}uuv-hil{part}.service" for part in ("", "-can", "-module", "-firewall")
)
FIREWALL = "/etc/uuv-hil/firewall.nft"
NFT = "/usr/sbin/nft"
RULES = "/etc/udev/rules.d/99-uuv-hil.rules"
LIMITS = "/etc/security/limits.d/uuv-hil.conf"
# In this folder the last file by name takes precedence; this one comes after default-wifi-powersave-on.conf.
MANAGER = "/etc/NetworkManager/conf.d/uuv-hil.conf"
# Kinds of serial devices by the kernel's names, for a link whose device does not exist yet; and the drivers of USB
# devices.
SERIAL_DRIVERS = ("ttyS", "ttyAMA", "ttyTHS", "ttyUSB", "ttyACM")
USB_DRIVERS = {"ttyUSB": "usbserial", "ttyACM": "cdc_acm"}
PI_ALIASES = ("/dev/serial0", "/dev/serial1")  # for a ttyS or a ttyAMA, as set in config.txt
# Interfaces that need no device, and the USB devices of gs_usb (Linux, drivers/net/can/usb/gs_usb.c).
WITHOUT_DEVICE = ("socketcan", "virtual", "mcast", "socketcand")
GS_USB = ("1d50:606f", "1209:2323", "1cd2:606f", "16d0:10b8")
# Interfaces that python-can opens at /dev/ttyUSB0@115200. slcan is our own, and has its rate from [link].
WITH_BAUD = ("robotell",)
ANY = ("0.0.0.0", "::")
MEMORY_MARGIN = 4  # MemoryMax as a multiple of the recommended memory
COMPANION_MEMORY = 768  # MemoryMax (MiB) of a service beside the slave
SYSTEM_SERVICE = 239  # first version of systemd with @system-service; older ones would forbid all system calls
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")  # valid names of users and interfaces in units
DEVICE = re.compile(r"/dev/[A-Za-z0-9_#+:=@./-]+")  # names made by udev, without the pattern characters of its rules


class Service(NamedTuple):
    """Settings of the service: it runs the slave of `scenario` as `user`, listening at `listen`, if given."""

    scenario: Scenario
    name: str  # name or path of the scenario, as given
    user: str
    listen: str | None = None
    board: str | None = None
    member: str | None = None
    changes: tuple[str, ...] = ()  # changed keys of the scenario, such as "master.speed=0.5"
    companions: tuple[Companion, ...] = ()

    @property
    def scenario_words(self) -> list[str]:
        """The scenario's name, or its path as it is valid in any folder, and the options that change it."""
        name = os.path.abspath(self.name) if self.name.endswith(".toml") else self.name
        return [name, *(word for change in self.changes for word in ("--set", change))]


def file_contents(tree: Tree, service: Service, board: Board | None) -> dict[str, str]:
    """Return the content of each file by path. Raises ConfigError if a name is not valid in a unit or a rule."""
    files = {UNIT: unit(tree, service, board), RULES: rules(tree, service, board)}
    files[LIMITS] = _fill("systemd/limits.conf", {"user": service.user, "rtprio": str(LOOP_PRIORITY)})
    files |= {f"{UNITS}uuv-hil-{one.name}.service": companion_unit(tree, service, one) for one in service.companions}
    if _can_interface(service.scenario):
        interface = _can_interface(service.scenario)
        module = next((bus.module for bus in board.can if bus.interface == interface), "") if board else ""
        files[CAN_UNIT] = can_unit(service.scenario, module)
        if module:
            files[MODULE_UNIT] = _fill("systemd/uuv-hil-module.service", {"module": module})
    if ports := reachable_ports(service):
        files[FIREWALL] = _fill("systemd/firewall.nft", {"ports": ", ".join(map(str, ports))})
        files[FIREWALL_UNIT] = _fill("systemd/uuv-hil-firewall.service", {"nft": NFT, "rules": FIREWALL})
    if tree.exists(os.path.dirname(MANAGER)):
        files[MANAGER] = _fill("systemd/networkmanager.conf", {})
    return files


def reachable_ports(service: Service) -> tuple[int, ...]:
    """Return the TCP ports of the slave, and of the services beside it, that other machines can reach."""
    addresses = [*slave_addresses(service.scenario), *(one for other in service.companions for one in other.addresses)]
    reachable = {one.port for one in addresses if one.use == "tcp" and one.port and not one.is_loopback}
    return tuple(sorted(reachable))


def firewall_missing(tree: Tree, service: Service) -> str:
    """Return the manual step that is needed to limit the rate of connections; empty if there is none."""
    if tree.exists(NFT) or not reachable_ports(service):
        return ""
    return f"without {NFT} the rate of new connections is not limited; install it: sudo apt install nftables"


def unknown_device(scenario: Scenario) -> str:
    """Return the manual step that permits the service to open its device; empty if there is none."""
    address = parse_address(scenario.link.port)
    if address.kind != "can" or address.interface in (*WITHOUT_DEVICE, "gs_usb") or address.target.startswith("/dev/"):
        return ""
    remedy = "permit it with: sudo systemctl edit uuv-hil, [Service] DeviceAllow=/dev/... rw"
    return f"the device that {scenario.link.port} opens is known only to python-can; {remedy}"


def unit(tree: Tree, service: Service, board: Board | None) -> str:
    """Return the slave's unit for systemd."""
    scenario = service.scenario
    kinds = serial_drivers(tree, serial_device(scenario, board))
    values = {
        "description": f"slave: {single_line(scenario.description) or single_line(service.name)}",
        "type": "notify",
        "watchdog": "10",
        "command": _command_line(command(service)),
        "rtprio": str(LOOP_PRIORITY if scenario.slave.realtime else 0),
        "memory_max": f"{MEMORY_MARGIN * (board.recommended.memory if board else 64):.0f}M",
        "cpu_weight": "500",
        "oom_score": "-500",
        # With a private /tmp, other programs would not find a pty in /tmp.
        "private_tmp": "no" if parse_address(scenario.link.port).target.startswith("/tmp/") else "yes",
        "devices": "\n".join(_devices(scenario, kinds)),
        "writable": _writable([scenario.recording.folder if scenario.recording.slave else ""]),
    }
    needs = needed_units(kinds, slave_addresses(scenario))
    needs += [os.path.basename(CAN_UNIT)] if _can_interface(scenario) else []
    return _fill_unit(tree, service, values, needs)


def companion_unit(tree: Tree, service: Service, companion: Companion) -> str:
    """Return the unit of a service beside the slave. It starts after the slave, or before it if that connects to it."""
    devices = [one.host for one in companion.addresses if one.use == "serial"]
    kinds = dict.fromkeys(kind for device in devices for kind in serial_drivers(tree, device))
    values = {
        "description": single_line(f"{companion.name} beside the slave of {service.name}"),
        "command": _command_line(module_command("hil.cli", *companion.words)),
        "environment": " ".join(map(escape_word, companion.environment)),
        "devices": "\n".join(f"DeviceAllow=char-{kind} rw" for kind in kinds),
        "writable": _writable(companion.folders),
        "order": f"{'Before' if KINDS[companion.name].before_slave else 'After'}={os.path.basename(UNIT)}",
    }
    return _fill_unit(tree, service, values, needed_units(kinds, companion.addresses))


def needed_units(kinds: Iterable[str], addresses: Iterable[Address]) -> list[str]:
    """Return the units that load the drivers of serial devices, and wait for the network that addresses need."""
    needs = [f"modprobe@{USB_DRIVERS[kind]}.service" for kind in kinds if kind in USB_DRIVERS]
    waits = any(one.use != "serial" and not one.is_loopback and one.host not in ANY for one in addresses)
    return needs + (["network-online.target"] if waits else [])


def can_unit(scenario: Scenario, module: str = "") -> str:
    """Return the unit that sets the bit rate of the link's CAN interface, after loading its kernel `module`, if any."""
    name = _can_interface(scenario)
    escaped = re.sub(r"[^A-Za-z0-9:_.]", lambda match: f"\\x{ord(match[0]):02x}", name)  # see systemd-escape(1)
    values = {
        "interface": name,
        "device": f"sys-subsystem-net-devices-{escaped}.device",
        "module": f"Wants={os.path.basename(MODULE_UNIT)}" if module else "",
        "bitrate": str(scenario.link.bitrate),
        "ip": "/sbin/ip",
    }
    return _fill("systemd/uuv-hil-can.service", values)


def rules(tree: Tree, service: Service, board: Board | None) -> str:
    """Return the rules for udev."""
    device = serial_device(service.scenario, board)
    lines = ["# No rule: the link uses no serial device."]
    if device.startswith("/dev/"):
        if not DEVICE.fullmatch(device):
            raise ConfigError(f"{device!r} is not valid in a rule: use only letters, digits, _ # + : = @ . / -")
        name = device.removeprefix("/dev/")
        # The kernel's names begin with tty. Others are links, and matched as links, because their targets may change.
        is_kernel_name = re.fullmatch(r"tty[A-Za-z]+[0-9]+", name) and not tree.link(device)
        match = "KERNEL" if is_kernel_name else "SYMLINK"
        lines = [f'SUBSYSTEM=="tty", {match}=="{name}", GROUP="dialout", MODE="0660", ENV{{ID_MM_DEVICE_IGNORE}}="1"']
    elif parse_address(service.scenario.link.port).interface == "gs_usb":
        form = 'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{}", ATTR{{idProduct}}=="{}", GROUP="dialout", MODE="0660"'
        lines = [form.format(*numbers.split(":")) for numbers in GS_USB]
    return _fill("udev/99-uuv-hil.rules", {"link": "\n".join(lines), "iw": "/usr/sbin/iw"})


def serial_device(scenario: Scenario, board: Board | None) -> str:
    """Return the serial port that a scenario's link uses on a board; empty if it uses none."""
    address = parse_address(scenario.link.port)
    if address.interface in WITH_BAUD and address.target.startswith("/dev/"):
        return address.target.partition("@")[0]
    if address.kind in ("uart", "rs485") or (address.kind == "can" and address.target.startswith("/dev/")):
        return address.target
    return board.uart if board and scenario.stm32 == "device" and scenario.link.port == "pty:" else ""


def serial_drivers(tree: Tree, device: str) -> tuple[str, ...]:
    """Return the kinds of serial devices that a name may refer to: one if it exists, else all that are possible."""
    if not device.startswith("/dev/"):
        return ()
    if device in PI_ALIASES:
        return SERIAL_DRIVERS[:2]
    kind = os.path.basename(tree.resolve(device)).rstrip("0123456789")
    if re.fullmatch("tty[A-Za-z]+", kind):
        return (kind,)
    return tuple(USB_DRIVERS) if device.startswith("/dev/serial/by-id/") else SERIAL_DRIVERS


def command(service: Service) -> list[str]:
    """Return the slave's command."""
    name, *changes = service.scenario_words
    words = module_command("hil.cli", "slave", name)
    for option, value in (("--listen", service.listen), ("--board", service.board), ("--member", service.member)):
        words += [option, value] if value else []
    return words + changes


def python_path() -> str:
    """Return the folder of the project's packages."""
    return os.path.dirname(preset_folder(FOLDER))


def escape_word(text: str) -> str:
    """Return a word or path escaped for a unit, see systemd.syntax(7). In commands $ must also be doubled.

    Raises ConfigError for characters that are not valid in a unit.
    """
    if not text.isprintable():
        raise ConfigError(f"{text!r} has characters that are not valid in a unit: rename it")
    for character, written in (("\\", "\\\\"), ('"', '\\"'), ("%", "%%")):
        text = text.replace(character, written)
    return f'"{text}"' if re.search(r"[\s'\\;]", text) else text


def single_line(text: str) -> str:
    """Return text for a unit: one line, without a backslash at its end, which would join the next line."""
    printable = "".join(character if character.isprintable() else " " for character in text)
    return " ".join(printable.split()).rstrip("\\ ").replace("%", "%%")


def _command_line(words: Sequence[str]) -> str:
    return " ".join(escape_word(word).replace("$", "$$") for word in words)


def _writable(folders: Iterable[str]) -> str:
    return "\n".join(f"ReadWritePaths={escape_word('-' + folder)}" for folder in folders if os.path.isabs(folder))


def _fill_unit(tree: Tree, service: Service, values: dict[str, str], needs: Sequence[str]) -> str:
    """Return the unit of the slave or of a service beside it; values that are not given are those of the latter."""
    version = re.match(r"systemd (\d+)", tree.run("systemctl", "--version") or "")
    usual = {
        "type": "simple", "watchdog": "0", "environment": "", "rtprio": "0", "memory_max": f"{COMPANION_MEMORY}M",
        "cpu_weight": "100", "oom_score": "0", "private_tmp": "yes", "order": "",
        "wants": f"Wants={' '.join(needs)}" if needs else "",
        "after": " ".join(["network.target", "time-sync.target", *needs]),
        "pythonpath": escape_word(python_path()),
        "user": service.user,
        "system_calls": "" if version and int(version[1]) < SYSTEM_SERVICE else "SystemCallFilter=@system-service",
    }  # fmt: skip
    return _fill("systemd/uuv-hil.service", usual | values)


def _devices(scenario: Scenario, kinds: tuple[str, ...]) -> list[str]:
    lines = [f"DeviceAllow=char-{kind} rw" for kind in kinds]
    if parse_address(scenario.link.port).interface == "gs_usb":
        lines.append("DeviceAllow=char-usb_device rw")
    keeps_awake = scenario.slave.realtime and scenario.slave.stay_awake
    return lines + (["DeviceAllow=/dev/cpu_dma_latency w"] if keeps_awake else [])


def _can_interface(scenario: Scenario) -> str:
    address = parse_address(scenario.link.port)
    if address.interface != "socketcan" or address.target.startswith("vcan"):
        return ""
    if not NAME.fullmatch(address.target):
        raise ConfigError(
            f"{scenario.link.port}: {address.target!r} is not valid in a unit: use only letters, digits, _ . -"
        )
    return address.target


def _fill(template: str, values: dict[str, str]) -> str:
    """Return a file of boards/ with every @name@ replaced."""
    with open(os.path.join(preset_folder(FOLDER), template), encoding="utf-8") as file:
        text = file.read()
    text = re.sub(r"@([a-z_]+)@", lambda match: values[match[1]], text)
    return re.sub(r"[ \t]+$", "", re.sub(r"\n{3,}", "\n\n", text), flags=re.MULTILINE)
