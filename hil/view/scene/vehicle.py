"""A vehicle in the scene: the form of its hull, thrusters, fins, meshes, and what its sensors see."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from sim.sensors.sensor_set import SensorSet
from sim.vehicle.vehicle import Vehicle

SLENDER = 4.0  # length over width from which on a hull is a torpedo


def vehicle_content(vehicle: Vehicle) -> Mapping[str, Any]:
    """Return a vehicle's shape (m, FRD)."""
    length, width, height = vehicle.dimensions
    return {
        "dimensions": vehicle.dimensions,
        "kind": "torpedo" if length > SLENDER * max(width, height) else "frame",
        "boxes": vehicle.hull.boxes if vehicle.hull else (),
        "thrusters": [
            {"name": each.name, "position": each.position, "direction": each.unit_direction,
             "diameter": each.propeller_diameter, "most": max(each.max_forward, each.max_reverse)}
            for each in vehicle.thrusters
        ],
        "fins": [
            {"position": each.position, "axis": each.axis, "chord": each.chord, "area": each.area,
             "aspect_ratio": each.aspect_ratio}
            for each in vehicle.fins
        ],
        "meshes": [triangles for mesh in vehicle.meshes if (triangles := _triangles(mesh)) is not None],
        "lamps": bool(vehicle.accessories),
    }  # fmt: skip


def sensor_content(sensors: SensorSet) -> dict[str, Any]:
    """Return where each camera and sonar is, and how far and wide it sees (m, rad, FRD)."""
    shown = {}
    for name, spec in sensors.items():
        model, kind = spec.model, spec.sensor.topic
        seen: dict[str, Any] = {"kind": kind, "position": spec.mounting.position, "attitude": spec.mounting.quaternion}
        if kind == "camera":
            seen |= {"width": model.field_of_view, "aspect": model.width / model.height, "lamps": model.lamps}
        elif kind == "forward_sonar":
            seen |= {"width": model.sector, "height": model.beam_height, "range": model.max_range}
        elif kind != "side_scan":
            continue
        shown[name] = seen
    return shown


def _triangles(mesh: Any) -> Any:
    """Return the corners of a mesh file's triangles (n x 3, m, FRD); None if there is no such file."""
    from sim.rotations import from_euler, matrix
    from sim.vehicle.mesh_files import load_mesh

    if not os.path.exists(mesh.file):
        return None
    loaded = load_mesh(mesh.file)
    rotation = np.array(matrix(from_euler(*mesh.orientation))).reshape(3, 3)
    placed = (loaded.vertices * mesh.scale) @ rotation.T + mesh.position
    return np.round(placed[loaded.faces].reshape(-1, 3), 4)
