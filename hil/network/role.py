"""The roles that a process can have on the network."""

from typing import Literal

Role = Literal["slave", "master", "planner", "client", "router", "imaging"]
