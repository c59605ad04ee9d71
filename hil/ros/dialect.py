"""The ROS 2 domain and release that this process uses on the network.

They are the same for the whole process, as in ROS itself. The domain is that of the scenario, [ros] domain; without it
that of the variable ROS_DOMAIN_ID, as in ROS; else 0. All processes of one vehicle must use the same domain.
"""

import os
import re

from hil.common.errors import ConfigError

RELEASES = ("humble", "jazzy", "kilted", "lyrical", "rolling")
LATER = RELEASES[3:]  # releases with simulation_interfaces 2
FROM_ENVIRONMENT = -1
MAX_DOMAIN = 232  # limit of ROS 2
NO_HASH = "TypeHashNotSupported"  # sent by Humble instead of the hash of a type

_chosen: tuple[int, str] = (FROM_ENVIRONMENT, "jazzy")


def is_newer(distro: str) -> bool:
    """Return whether this is the name of a release later than the ones known here; it acts as rolling."""
    return distro not in RELEASES and bool(re.fullmatch("[a-z]{4,20}", distro)) and distro > RELEASES[-2]


def select(domain: int = FROM_ENVIRONMENT, distro: str = "jazzy") -> None:
    """Set domain and release for this process. Raises ConfigError if the environment has an invalid domain."""
    global _chosen  # noqa: PLW0603 - one for the process, see above
    _chosen = domain if domain >= 0 else _from_environment(), distro if distro in RELEASES else "rolling"


def domain() -> int:
    """Return the domain; the environment is read once."""
    if _chosen[0] < 0:
        select(*_chosen)
    return _chosen[0]


def release() -> str:
    """Return the release, one of RELEASES."""
    return _chosen[1]


def is_humble() -> bool:
    """Return whether the release is Humble: types have no hashes, and sensor_msgs/Range no variance."""
    return _chosen[1] == "humble"


def _from_environment() -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdecimal() or int(text[:9]) > MAX_DOMAIN:
        raise ConfigError(
            f"ROS_DOMAIN_ID: {text!r} is no domain, which are 0 to {MAX_DOMAIN}; unset it, or give [ros] domain"
        )
    return int(text)
