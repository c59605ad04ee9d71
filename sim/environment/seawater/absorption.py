"""Absorption of sound in sea water, by frequency (dB/m), which limits the range of sonars."""


def francois_garrison(
    frequency: float, temperature: float = 10.0, salinity: float = 35.0, depth: float = 10.0, acidity: float = 8.0
) -> float:
    """Return the absorption (dB/m) at a frequency (Hz), temperature (deg C), salinity (PSU), depth (m) and pH.

    Francois & Garrison 1982 (J. Acoust. Soc. Am. 72(6):1879): boric acid, magnesium sulphate, and water itself. The
    error is at most 5 % between 10 and 500 kHz; above that only the water matters. Fresh water has salinity 0.
    """
    f, t, s = frequency * 1e-3, temperature, salinity
    speed = 1412.0 + 3.21 * t + 1.19 * s + 0.0167 * depth
    kelvin = 273.0 + t
    boric = 2.8 * (s / 35.0) ** 0.5 * 10.0 ** (4.0 - 1245.0 / kelvin)  # relaxation frequency, kHz
    magnesium = 8.17 * 10.0 ** (8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (s - 35.0))
    if t <= 20.0:
        water = 4.937e-4 - 2.59e-5 * t + 9.11e-7 * t**2 - 1.50e-8 * t**3
    else:
        water = 3.964e-4 - 1.146e-5 * t + 1.45e-7 * t**2 - 6.5e-10 * t**3
    by_boric = 8.86 / speed * 10.0 ** (0.78 * acidity - 5.0) * boric / (boric**2 + f**2) if s else 0.0
    by_magnesium = 21.44 * s / speed * (1.0 + 0.025 * t) * (1.0 - 1.37e-4 * depth + 6.2e-9 * depth**2)
    by_magnesium *= magnesium / (magnesium**2 + f**2)
    by_water = water * (1.0 - 3.83e-5 * depth + 4.9e-10 * depth**2)
    decibels: float = (by_boric + by_magnesium + by_water) * f * f * 1e-3
    return decibels
