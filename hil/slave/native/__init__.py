"""What makes pulses of each command, in C where it was compiled, else in Python: the same numbers to the last bit.

A command waits for this on its way, and between two of them the processor forgets the code: twenty milliseconds later
Python's way through controller, allocation and curves takes four times as long as at once again, the C a fraction of
it. `sim.native` has the switch.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from struct import pack
from typing import TYPE_CHECKING

from hil.autonomy.allocation import Allocator
from hil.autonomy.control import NO_RESIDUAL, CascadedController, Gains, Navigation, VelocityCommand, Wrench
from sim.native import has_native
from sim.thruster_model import Thruster
from sim.thrusters import curve_numbers, pulse_finder

if TYPE_CHECKING:
    from hil.links.contract import Protocol, Wire
    from hil.links.frame.protocol import FrameProtocol
    from hil.slave.native.firmware import FirmwareEnd

PulseFinder = Callable[[Sequence[float]], tuple[int, ...]]


class NativeCascade(CascadedController):
    """`CascadedController` with its loops in C. Raises ImportError where there is none."""

    def __init__(self, gains: Gains, inertia: Wrench) -> None:
        from hil.slave.native._control import Cascade

        super().__init__(gains, inertia)
        self._cascade = Cascade(_doubles(self.numbers()))

    def reset(self) -> None:
        """As the one it stands for."""
        self._cascade.reset()

    def update(
        self, command: VelocityCommand, navigation: Navigation, dt: float, residual: Wrench = NO_RESIDUAL
    ) -> Wrench:
        """As the one it stands for."""
        return self._cascade.update(command, navigation, dt, residual)


class NativeAllocator(Allocator):
    """`Allocator` with its sums in C. Raises ImportError where there is none."""

    def __init__(
        self, matrix: Sequence[Sequence[float]], max_forward: Sequence[float], max_reverse: Sequence[float]
    ) -> None:
        from hil.slave.native._control import Allocation

        super().__init__(matrix, max_forward, max_reverse)
        self._allocate = Allocation(_doubles(self.numbers())).allocate

    def allocate(self, wrench: Sequence[float]) -> tuple[list[float], Wrench]:
        """As the one it stands for."""
        return self._allocate(wrench)


def native_pulse_finder(thrusters: Sequence[Thruster]) -> PulseFinder:
    """`pulse_finder` of thrusters without curves of their own, all at once. Raises ImportError where there is no C."""
    from hil.slave.native._control import Pulses

    return Pulses(_doubles([number for thruster in thrusters for number in curve_numbers(thruster)])).find


def make_cascade(gains: Gains, inertia: Wrench) -> CascadedController:
    """The quickest cascade there is. Raises ConfigError as `sim.native.choose` does."""
    return (NativeCascade if _has("_control") else CascadedController)(gains, inertia)


def make_allocator(
    matrix: Sequence[Sequence[float]], max_forward: Sequence[float], max_reverse: Sequence[float]
) -> Allocator:
    """The quickest allocator there is; else as `make_cascade`."""
    return (NativeAllocator if _has("_control") else Allocator)(matrix, max_forward, max_reverse)


def make_pulse_finder(thrusters: Sequence[Thruster]) -> PulseFinder:
    """What turns the thrust of each thruster (N) into its pulse (us), the quickest there is; else as `make_cascade`."""
    if _has("_control") and all(thruster.curve is None for thruster in thrusters):
        return native_pulse_finder(thrusters)
    finders = [pulse_finder(thruster) for thruster in thrusters]
    return lambda thrusts: tuple([find(thrust) for find, thrust in zip(finders, thrusts, strict=True)])


def make_frame_protocol(protocol: "FrameProtocol", channels: int) -> "Protocol":
    """`protocol`, or what does the same for so many thrusters quicker, if there is such; else as `make_cascade`."""
    if not _has("_frame"):
        return protocol
    from hil.slave.native.frame import NativeFrameProtocol, is_ours

    return NativeFrameProtocol(protocol) if is_ours(protocol, channels) else protocol


def make_firmware_end(protocol: "Protocol", wire: "Wire", channels: int, watchdog_ns: int) -> "FirmwareEnd | None":
    """The firmware on its end of `wire`, if that was compiled and speaks `protocol`; else as `make_cascade`."""
    if not _has("_firmware"):
        return None
    from hil.slave.native.frame import NativeFrameProtocol

    if not isinstance(protocol, NativeFrameProtocol):
        return None
    from hil.slave.native.firmware import FirmwareEnd

    return FirmwareEnd(wire, channels, watchdog_ns)


def _has(binary: str) -> bool:
    if not has_native():
        return False
    try:
        import_module(f"hil.slave.native.{binary}")
    except ImportError:  # made before there was one
        return False
    return True


def _doubles(numbers: Sequence[float]) -> bytes:
    return pack(f"{len(numbers)}d", *numbers)
