"""An imported vehicle whose fins cannot hold its heading with the whole Munk moment gets none of pitch and yaw."""

from hil.commands.vehicle.import_urdf import _steerable
from sim.vehicle.vehicle import load_vehicle

WHOLE = (1.0, 1.0, 1.0)


def test_the_munk_moment_is_left_out_only_where_fins_cannot_hold_it() -> None:
    notes = list[str]()
    tethys = load_vehicle("tethys")[0]._replace(munk_share=WHOLE)
    assert _steerable(tethys, notes).munk_share == (1.0, 0.0, 0.0)
    assert len(notes) == 1
    for name in ("lauv", "bluerov2"):
        vehicle = load_vehicle(name)[0]
        assert _steerable(vehicle, notes) == vehicle
    assert len(notes) == 1
