"""Files that a vehicle's URDF names, for Foxglove: meshes and their pictures in ROS packages of this machine."""

import os
import re

from hil.common.errors import ConfigError
from hil.gateways.websocket_client import MAX_BYTES
from sim.vehicle.urdf.ros_packages import find_packages

# No other files, and none outside a package: a client that may read topics may ask.
_ALLOWED = re.compile(
    r"package://([\w-]+)/((?:[\w-]+/)*[\w.-]+\.(dae|glb|gltf|jpe?g|mtl|obj|png|stl|tiff?|webp))", re.A | re.I
)


def read_asset(uri: str) -> bytes:
    """Return the file of a package:// address; packages are found as by ROS, or near the current folder.

    Raises ConfigError.
    """
    allowed = _ALLOWED.fullmatch(uri)
    if not allowed:
        raise ConfigError(f"{uri[:200]!r}: only meshes and pictures, at package://PACKAGE/PATH, are served")
    folders = find_packages(allowed[1], os.path.join(os.getcwd(), "any"))
    package = next((folder for folder in folders if os.path.isfile(os.path.join(folder, "package.xml"))), None)
    if package is None:
        raise ConfigError(f"{uri}: no package {allowed[1]!r} here; source its workspace before the gateway starts")
    try:
        with open(os.path.join(package, allowed[2]), "rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{uri}: {error.strerror}") from None
    if len(data) > MAX_BYTES:
        raise ConfigError(f"{uri}: more than {MAX_BYTES >> 20} MiB")
    return data
