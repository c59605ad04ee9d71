"""Name of the part that a process plays on the network."""

from typing import Literal

Role = Literal["slave", "master", "planner", "client", "router", "imaging"]
