"""Draw signal-to-noise ratio and packet loss of modems over range, for docs/explanation/modems.md.

    python -m tools.pages.modem_figure

It writes docs/explanation/modems/range.png, and prints the ranges at which half of the messages are lost. Curves are
the formulas of sim/modems. Points are shares of messages that the channels of sim/modems lost.
"""

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import exp, log10
from typing import Any

from hil.plots.plotting import pyplot
from hil.scenario.modem import ModemReport, encode_report
from sim.modems.acoustic import NS, AcousticChannel, AcousticModem
from sim.modems.optical import OpticalModem, bit_error, quality
from sim.modems.optical_channel import OpticalChannel, Pose
from sim.modems.sound import ambient_noise, power, transmission_loss

SIZE = len(encode_report(ModemReport((0.0, 0.0, 0.0), (0.0, 0.0), 0)))
DEPTH = 50.0
MESSAGES = 400
LEVEL = (1.0, 0.0, 0.0, 0.0)
AHEAD, BACK = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)
# The modem's own source level, and a lower one that saves the battery.
SOUND = {"168 dB, calm": (168.0, 0.0), "168 dB, wind 10 m/s": (168.0, 10.0), "140 dB, wind 5 m/s": (140.0, 5.0)}
LIGHT = {"pure sea 0.056 /m": 0.056, "clear ocean 0.15 /m": 0.15, "coast 0.4 /m": 0.4, "harbour 2.2 /m": 2.2}

Point = tuple[float, float]  # signal-to-noise ratio in dB, share of messages that are lost


def main() -> int:
    """Draw the figure, print the ranges at which half of the messages are lost; return 0."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    folder = os.path.join("docs", "explanation", "modems")
    os.makedirs(folder, exist_ok=True)
    plt = pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(11, 7), sharex="col", layout="constrained")
    for number, (label, (level, wind)) in enumerate(SOUND.items()):
        modem = AcousticModem(source_level=level, wind=wind)
        _curves(axes[:, 0], _steps(50.0, 12_000.0), label, f"C{number}", partial(by_sound, modem))
        _points(axes[1, 0], _steps(50.0, 12_000.0, 24), f"C{number}", partial(lost_by_sound, modem))
    for number, (label, attenuation) in enumerate(LIGHT.items()):
        lamp = OpticalModem(attenuation=attenuation)
        _curves(axes[:, 1], _steps(1.0, 60.0), label, f"C{number}", partial(by_light, lamp))
        _points(axes[1, 1], _steps(1.0, 60.0, 30), f"C{number}", partial(lost_by_light, lamp))
    _label(axes)
    path = os.path.join(folder, "range.png")
    figure.savefig(path, dpi=110)
    print(path)
    return 0


def by_sound(modem: AcousticModem, distance: float) -> Point:
    """Return signal-to-noise ratio (dB) and packet loss of the acoustic modem at `distance` m, by the formulas."""
    noise = ambient_noise(modem.frequency, modem.wind, modem.shipping) + 10.0 * log10(modem.bandwidth)
    snr = modem.source_level - transmission_loss(distance, modem.frequency, modem.spreading) - noise
    errors = 0.5 * exp(-0.5 * power(snr) * modem.bandwidth / modem.bit_rate)
    return snr, 1.0 if snr < modem.detection else 1.0 - (1.0 - errors) ** (8 * SIZE)


def by_light(modem: OpticalModem, distance: float) -> Point:
    """Return signal-to-noise ratio (dB) and packet loss of optical modems at `distance` m that face each other."""
    errors = bit_error(modem, (0.0, 0.0, 0.0), AHEAD, (distance, 0.0, 0.0), BACK)
    q = quality(errors)
    return (20.0 * log10(q) if q > 0.0 else -99.0), 1.0 - float((1.0 - errors) ** (8 * SIZE))


def lost_by_sound(modem: AcousticModem, distance: float) -> float:
    """Return the share of messages that the acoustic channel lost over `distance` m."""
    places = {"a": (0.0, 0.0, 10.0), "b": (distance, 0.0, 10.0)}
    return _lost(AcousticChannel(modem, DEPTH, seed=1), places, 20 * NS)


def lost_by_light(modem: OpticalModem, distance: float) -> float:
    """Return the share of messages that the optical channel lost over `distance` m."""
    places = {"a": Pose((0.0, 0.0, 10.0), LEVEL), "b": Pose((distance, 0.0, 10.0), LEVEL)}
    return _lost(OpticalChannel(modem, seed=1), places, NS)


def _lost(channel: Any, poses: Mapping[str, Any], period_ns: int) -> float:
    """Send messages from a to b, one each period; return the share that was not received."""
    for number in range(MESSAGES):
        channel.send(number * period_ns, "a", bytes(SIZE), poses)
        channel.receive((number + 1) * period_ns - 1)
    return float(1.0 - channel.counts["delivered"] / MESSAGES)


def _steps(first: float, last: float, count: int = 400) -> list[float]:
    return [first + (last - first) * number / (count - 1) for number in range(count)]


def _curves(pair: Sequence[Any], ranges: list[float], label: str, color: str, at: Callable[[float], Point]) -> None:
    snr, lost = zip(*map(at, ranges), strict=True)
    upper, lower = pair
    upper.plot(ranges, snr, color=color, label=label)
    lower.plot(ranges, [100.0 * share for share in lost], color=color, label=label)
    half = next((x for x, share in zip(ranges, lost, strict=True) if share > 0.5), None)
    print(f"{label}: half of the messages are lost at {f'{half:.4g} m' if half else 'none of these ranges'}")


def _points(axes: Any, ranges: list[float], color: str, lost: Callable[[float], float]) -> None:
    axes.plot(ranges, [100.0 * lost(x) for x in ranges], "o", color=color, markersize=3)


def _label(axes: Any) -> None:
    (sound, light), (lost_sound, lost_light) = axes
    sound.set(title="Acoustic: Nanomodem V3, 28 kHz, 640 bit/s", ylabel="signal to noise (dB)", ylim=(-20, 80))
    light.set(title="Optical: 1 Mbit/s, head on", ylim=(-30, 31))
    lost_sound.set(xlabel="range (m)", ylabel=f"messages of {SIZE} bytes lost (%)", xlim=(0, 12_000))
    lost_light.set(xlabel="range (m)", xlim=(0, 60))
    for each in (sound, light, lost_sound, lost_light):
        each.grid(alpha=0.3)
    sound.legend(fontsize="small")
    light.legend(fontsize="small")


if __name__ == "__main__":
    sys.exit(main())
