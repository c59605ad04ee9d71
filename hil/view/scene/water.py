"""The colours of the water and of the seabed in the scene, from the optics of the simulated cameras."""

from collections.abc import Mapping
from math import log
from typing import Any

from sim.environment.bottom import PROPERTIES, Bottom
from sim.environment.optics import jerlov
from sim.environment.things.natures import NATURES
from sim.sensors.sensor_set import SensorSet

USUAL = "II"  # where no camera says in which water it looks
SHALLOW, DEEP = 2.0, 12.0  # m; the decrease of daylight is measured between them


def water_content(sensors: SensorSet) -> Mapping[str, Any]:
    """Return the water of the first camera: per colour, attenuation, backscatter and decrease of daylight (1/m)."""
    kinds = [str(spec.model.water) for spec in sensors.values() if hasattr(spec.model, "water")]
    kind = kinds[0] if kinds else USUAL
    water, shallow, deep = jerlov(kind, SHALLOW), jerlov(kind, SHALLOW), jerlov(kind, DEEP)
    daylight = [log(a / b) / (DEEP - SHALLOW) for a, b in zip(shallow.light, deep.light, strict=True)]
    return {
        "kind": kind, "attenuation": water.attenuation, "backscatter": water.backscatter, "veil": water.veil,
        "daylight": daylight,
    }  # fmt: skip


def bottom_content(bottom: Bottom | None) -> Mapping[str, Any]:
    """Return the seabed's material: its kind, ripples, and the colour (linear, 0 to 1) of each of S-57's numbers."""
    bottom = bottom or Bottom()
    roughness = PROPERTIES[bottom.kind].height if bottom.roughness is None else bottom.roughness
    return {
        "kind": bottom.kind, "code": NATURES[bottom.kind].code, "roughness": roughness,
        "ripples": (bottom.ripple_height, bottom.ripple_length, bottom.ripple_heading),
        "natures": {each.code: (name, *each.colour, each.texture) for name, each in NATURES.items()},
    }  # fmt: skip
