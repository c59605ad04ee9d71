"""Units in which a file or an option may give a number, with their spellings and factors."""

import math

from hil.common.errors import ConfigError

# unit -> (unit of the same quantity that comes first here, factor to it)
UNITS: dict[str, tuple[str, float]] = {
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "min": ("s", 60.0), "h": ("s", 3600.0),
    "Hz": ("Hz", 1.0), "kHz": ("Hz", 1e3), "MHz": ("Hz", 1e6),
    "m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3), "km": ("m", 1e3), "nmi": ("m", 1852.0),
    "ft": ("m", 0.3048), "in": ("m", 0.0254), "fathom": ("m", 1.8288),
    "m/s": ("m/s", 1.0), "cm/s": ("m/s", 1e-2), "km/h": ("m/s", 1 / 3.6), "kn": ("m/s", 1852.0 / 3600.0),
    "ft/s": ("m/s", 0.3048),
    "rad": ("rad", 1.0), "mrad": ("rad", 1e-3), "deg": ("rad", math.pi / 180.0),
    "rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", math.pi / 180.0), "rpm": ("rad/s", math.pi / 30.0),
    "kg": ("kg", 1.0), "g": ("kg", 1e-3), "t": ("kg", 1e3), "lb": ("kg", 0.45359237),
    "N": ("N", 1.0), "kN": ("N", 1e3), "kgf": ("N", 9.80665), "lbf": ("N", 4.4482216152605),
    "Pa": ("Pa", 1.0), "hPa": ("Pa", 100.0), "kPa": ("Pa", 1e3), "mbar": ("Pa", 100.0), "bar": ("Pa", 1e5),
    "psi": ("Pa", 6894.757293168),
    "m³": ("m³", 1.0), "l": ("m³", 1e-3), "cm³": ("m³", 1e-6), "m³/s": ("m³/s", 1.0), "l/min": ("m³/s", 1e-3 / 60.0),
    "ml/s": ("m³/s", 1e-6), "m²": ("m²", 1.0), "cm²": ("m²", 1e-4),
    "kg/m³": ("kg/m³", 1.0), "g/cm³": ("kg/m³", 1e3), "kg/m": ("kg/m", 1.0), "g/m": ("kg/m", 1e-3),
    "m/s²": ("m/s²", 1.0), "V": ("V", 1.0), "mV": ("V", 1e-3), "A": ("A", 1.0), "mA": ("A", 1e-3),
    "W": ("W", 1.0), "kW": ("W", 1e3), "Wh": ("Wh", 1.0), "kWh": ("Wh", 1e3),
    "ohm": ("ohm", 1.0), "mohm": ("ohm", 1e-3), "T": ("T", 1.0), "uT": ("T", 1e-6), "nT": ("T", 1e-9),
    "°C": ("°C", 1.0), "dB": ("dB", 1.0), "bit/s": ("bit/s", 1.0), "kbit/s": ("bit/s", 1e3), "Mbit/s": ("bit/s", 1e6),
    "MiB": ("MiB", 1.0), "GiB": ("MiB", 1024.0),
}  # fmt: skip
# unit -> its other spellings
SPELLINGS: dict[str, tuple[str, ...]] = {
    "s": ("sec", "second", "seconds"), "ms": ("msec",), "us": ("µs", "μs", "usec"), "min": ("minute", "minutes"),
    "h": ("hr", "hour", "hours"), "Hz": ("hz",), "kHz": ("khz",),
    "m": ("metre", "metres", "meter", "meters"), "nmi": ("NM",), "ft": ("foot", "feet"), "in": ("inch", "inches"),
    "fathom": ("fathoms",), "m/s": ("mps",), "km/h": ("kmh", "kph"), "kn": ("kt", "kts", "knot", "knots"),
    "rad": ("radian", "radians"), "deg": ("°", "degree", "degrees"), "deg/s": ("°/s", "dps"), "rpm": ("RPM",),
    "t": ("tonne", "tonnes"), "lb": ("lbs",), "m³": ("m3", "m^3"), "l": ("L", "litre", "litres", "liter", "liters"),
    "cm³": ("cm3", "cm^3", "ml", "mL"), "m³/s": ("m3/s",), "l/min": ("L/min",), "m²": ("m2", "m^2"),
    "cm²": ("cm2", "cm^2"), "kg/m³": ("kg/m3", "kg/m^3"), "g/cm³": ("g/cm3", "kg/l"), "m/s²": ("m/s2", "m/s^2"),
    "ohm": ("Ω", "Ohm"), "mohm": ("mΩ",), "uT": ("µT",), "°C": ("C", "degC"),
    "bit/s": ("bps", "baud"), "kbit/s": ("kbps",), "Mbit/s": ("Mbps",),
}  # fmt: skip
NAMES = {spelling: name for name, several in SPELLINGS.items() for spelling in (name, *several)}


def units_of(unit: str) -> dict[str, float]:
    """Return the units of the same quantity as `unit`, in all spellings, with their factors to it."""
    first, factor = UNITS.get(unit, (unit, 1.0))
    return {
        spelling: own / factor if name != unit else 1.0
        for name, (si, own) in UNITS.items()
        if si == first
        for spelling in (name, *SPELLINGS.get(name, ()))
    }


def split_unit(text: str) -> tuple[str, str]:
    """Return the number and the unit of "200 ms" or "200ms"; the unit is "" if there is none."""
    text = text.strip()
    unit = text.lstrip("+-.,0123456789eE_ ")
    return text[: len(text) - len(unit)], unit


def with_unit(text: str, unit: str, where: str) -> float:
    """Return the number in text with a unit, "200 ms" or "200ms", in `unit`. Raises ConfigError at `where`."""
    number, own = split_unit(text)
    try:
        magnitude = float(number)
    except ValueError:
        raise ConfigError(f'{where}: expected a number and a unit like "1 {unit}", found {text[:60]!r}') from None
    name = NAMES.get(own, own)
    (first, factor), (own_first, own_factor) = UNITS[unit], UNITS.get(name, ("", 0.0))
    if first != own_first:
        fault = f"has the unit {own[:60]!r}" if own else f"has no unit: {text[:60]!r}"
        known = ", ".join(name for name in units_of(unit) if name in UNITS)
        raise ConfigError(f"{where}: {fault}; expected one of {known}")
    return magnitude if name == unit else magnitude * (own_factor / factor)
