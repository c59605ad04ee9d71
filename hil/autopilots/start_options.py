"""The options with which SITL programs are started, by this program or by hand."""

import os
from math import degrees

from hil.autopilots.inputs import HOME
from hil.links.address import parse_address
from hil.scenario.autopilot_records import COMPANION_PORT, GROUND_PORT, AutopilotSettings
from hil.scenario.config import Scenario
from sim.environment.world import World

AIRFRAME = "1022"  # PX4's underwater vehicle; parameters then set its geometry
SPEEDUP = 100  # faster than any run: this process sets the simulation time, the program waits for it


def ardusub_options(scenario: Scenario, settings: AutopilotSettings, world: World) -> list[str]:
    """Return the options of ArduSub's SITL program, without its file of parameters.

    Without --home it would start 584 m above the sea, and hold its depth by a pressure that is not that of water.
    """
    address = parse_address(settings.own_address("ardupilot"))
    latitude, longitude = world.origin or HOME
    home = f"{latitude:.7f},{longitude:.7f},0,{degrees(scenario.start.heading):.1f}"
    own = ["--model", f"JSON:{address.target}", "--speedup", str(SPEEDUP), "-I", str(settings.instance)]
    # the default port, but without waiting for a connection, and one for the companion
    own += ["--serial0", "tcp:0", "--serial5", f"tcp:{COMPANION_PORT - GROUND_PORT}"]
    return [*own, "--sim-port-out", str(address.port), "--home", home]


def start_hint(scenario: Scenario, settings: AutopilotSettings, world: World) -> str:
    """Return what a person does who starts the autopilot without us: for ArduSub its whole command."""
    name = os.path.splitext(os.path.basename(scenario.path))[0]
    if scenario.controller != "ardupilot":
        return (
            f"start PX4's SITL with PX4_SYS_AUTOSTART={AIRFRAME} and -i {settings.instance}, and load the file that "
            f"`uuv-hil autopilot parameters {scenario.path} -o {name}.params` writes"
        )
    options = " ".join(ardusub_options(scenario, settings, world))
    return (
        f"start ArduSub with these options: {options} --defaults {name}.parm; "
        f"the file is written by `uuv-hil autopilot parameters {scenario.path} > {name}.parm`"
    )
