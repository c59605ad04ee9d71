"""Apply the optics of water to a picture: the revised underwater image formation model.

    I = J exp(-beta_D z) + B (1 - exp(-beta_B z))          for each of red, green and blue

J is the radiance of the scene without water in front of the camera, z the distance (m) along the line of sight, B the
veil: the water's own colour at a great distance. Akkaynak & Treibitz 2018 (A Revised Underwater Image Formation Model,
CVPR) showed that the attenuation of the scene, beta_D, and the growth of the veil, beta_B, differ, because a camera's
colour channels are broad and the spectra of scene and veil differ. With beta_D = beta_B it is the model of McGlamery
1980 and Jaffe 1990 (IEEE J. Oceanic Eng. 15(2):101) without its forward-scattered part, a blur.

    from sim.environment.optics import jerlov, underwater
    wet = underwater(rgb, depth, jerlov("1C", depth=5.0))

Not modelled: that blur, polarisation.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.common.errors import ConfigError
from hil.common.schema import nearest, preset_folder
from hil.common.tables import read_table

Rgb = tuple[float, float, float]

# Spectral sensitivity of a camera's channels: Gaussians with these means and standard deviations (nm). They are our
# choice, close to the mean of the 28 cameras of Jiang et al. 2013 (What is the Space of Spectral Sensitivity Functions,
# WACV): Gaussians fitted to the means in its table, camspec_database.txt, have (608, 31), (534, 40), (465, 34).
_SENSITIVITY = {"red": (600.0, 30.0), "green": (535.0, 35.0), "blue": (460.0, 28.0)}
# Radiance of the veil over that of a white, level, matt surface in the same light. The water is lit from all sides by
# 1.25 times the light that falls on the surface (mean cosine 0.8) and scatters evenly to all sides: 1.25 / 4 pi over
# 1 / pi.
_VEIL = 1.25 / 4.0


class Water(NamedTuple):
    """Optical properties of water for red, green and blue: coefficients in 1/m, and relative radiances.

    Radiances are relative to that of a white surface under full daylight. `attenuation` is beta_D, `backscatter`
    beta_B, `veil` B. `light` is the share of daylight that remains at the depth of the scene: the caller of
    `underwater` multiplies a scene rendered in full daylight by it. `scattering` is the coefficient with which the
    water scatters a white lamp's light into all directions.
    """

    attenuation: Rgb
    backscatter: Rgb
    veil: Rgb
    light: Rgb = (1.0, 1.0, 1.0)
    scattering: Rgb = (0.0, 0.0, 0.0)


CLEAR = Water((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def jaffe_mcglamery(attenuation: Rgb, veil: Rgb) -> Water:
    """Return the special case in which scene and veil have the same coefficient (1/m)."""
    return Water(attenuation, attenuation, veil)


def underwater(rgb: ArrayLike, distance: ArrayLike, water: Water) -> NDArray[Any]:
    """Return the picture `rgb` (... x 3) as it appears through `water`; `distance` (...) is that of each pixel in m.

    Floats are linear radiances (white is 1), bytes are sRGB (IEC 61966-2-1); the result has the type of the input.
    Where the distance is not finite, only the veil is visible. The distance is measured along the ray: multiply a depth
    image, which is measured along the optical axis, by `ray_lengths` first.
    """
    picture = np.asarray(rgb)
    if picture.dtype == np.uint8:
        return encode(underwater(decode(picture), distance, water))
    distances = np.asarray(distance, np.float32)
    endless = ~np.isfinite(distances)
    distances = np.where(endless, np.float32(0.0), distances)
    wet = np.empty_like(picture, np.float32)
    for channel, coefficients in enumerate(zip(*water[:3], strict=True)):
        attenuation, backscatter, veil = map(np.float32, coefficients)
        seen = picture[..., channel] * np.exp(-attenuation * distances)
        seen += veil * (1.0 - np.exp(-backscatter * distances))
        wet[..., channel] = np.where(endless, veil, seen)
    return wet


def ray_lengths(width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> NDArray[np.float32]:
    """Return the ratio of distance along the ray to depth along the optical axis for each pixel: height x width."""
    x, y = np.meshgrid((np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy)
    lengths: NDArray[np.float32] = np.sqrt(1.0 + x * x + y * y).astype(np.float32)
    return lengths


def decode(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return linear radiances (0 to 1) of sRGB bytes."""
    return _LINEAR[picture]


def encode(radiance: NDArray[Any]) -> NDArray[np.uint8]:
    """Return sRGB bytes of linear radiances; above 1 is white."""
    grey: NDArray[np.uint8] = GREY[(np.clip(radiance, 0.0, 1.0) * np.float32(_STEPS)).astype(np.uint16)]
    return grey


def jerlov(water: str, depth: float = 5.0, distance: float | None = None, forward: float = 0.5) -> Water:
    """Return the water of a Jerlov type for a scene `depth` m deep in daylight.

    Computed over the spectrum as in section 4 of Akkaynak & Treibitz 2018, with beam attenuation c = a + b, daylight
    E = exp(-K_d depth) and the veil b E / c. Each channel is the mean over its sensitivity, for a grey scene. The two
    coefficients are valid at `distance` m, by default where c distance is 1 in the green. `forward` is the share of
    scattered light whose direction changes so little that it counts as not scattered: half is scattered by less than 5
    degrees (0.52, integrated from Petzold's mean particle, Mobley 1994, Light and Water, table 3.10); the paper uses 0.
    Absorption is that of pure water plus the excess of the type over type I, given in three bands and linear between
    them; scattering follows a power of the wavelength between the bands. The numbers and their sources are in
    sim/data/jerlov.toml; "clear" means no water at all. Raises ConfigError for an unknown type.
    """
    if water == "clear":
        return CLEAR
    spectrum = _spectrum(water)
    scattering = (1.0 - forward) * spectrum.scattering
    beam = spectrum.absorption + scattering
    if distance is None:
        distance = float(1.0 / beam[spectrum.wavelength == 550.0][0])
    daylight = np.exp(-spectrum.daylight * depth)
    veil = _VEIL * scattering / beam * daylight
    passing = np.exp(-beam * distance)
    channels = []
    for middle, width in _SENSITIVITY.values():
        response = np.exp(-0.5 * ((spectrum.wavelength - middle) / width) ** 2)
        lit, far = response @ daylight, response @ veil
        channels.append((
            -np.log(response @ (daylight * passing) / lit) / distance,
            -np.log(response @ (veil * passing) / far) / distance,
            far / response.sum(),
            lit / response.sum(),
            response @ spectrum.scattering / response.sum(),
        ))  # fmt: skip
    return Water(*(tuple(map(float, row)) for row in zip(*channels, strict=True)))  # type: ignore[arg-type]  # three each


class _Spectrum(NamedTuple):
    wavelength: NDArray[np.float64]
    absorption: NDArray[np.float64]
    scattering: NDArray[np.float64]
    daylight: NDArray[np.float64]


@lru_cache
def _spectrum(water: str) -> _Spectrum:
    table = read_table(f"{preset_folder('sim/data')}/jerlov.toml")
    types = table["types"]
    if water not in types:
        raise ConfigError(f"no water {water!r}{nearest(water, list(types))}; there are: clear, {', '.join(types)}")
    kind, clearest = types[water], types["I"]
    wavelength = np.array(table["wavelength"], float)
    bands = np.array([table["bands"][band] for band in ("blue", "green", "red")], float)
    more = np.array(kind["absorption"][::-1]) - np.array(clearest["absorption"][::-1])
    absorption = np.array(table["pure_water"]) + np.interp(wavelength, bands, np.maximum(more, 0.0))
    scattering = np.exp(np.interp(np.log(wavelength), np.log(bands), np.log(kind["scattering"][::-1])))
    return _Spectrum(wavelength, absorption, scattering, np.array(kind["daylight"]))


def _linear(grey: NDArray[Any]) -> NDArray[np.float64]:
    return np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4)


_STEPS = 8191  # intervals of the lookup table of `encode`: fine enough for each of the 256 levels
_LINEAR = _linear(np.arange(256) / 255.0).astype(np.float32)
# The lookup table: the nearest level for each of _STEPS + 1 radiances from 0 to 1.
GREY = np.searchsorted(_linear((np.arange(255) + 0.5) / 255.0), np.arange(_STEPS + 1) / _STEPS).astype(np.uint8)
