"""A contact switch behind the bumper."""

from typing import Annotated, NamedTuple

from hil.common.schema import Range
from sim.dynamics import State
from sim.sensors.extra_samples import FlagSample
from sim.sensors.mounting import Mounting
from sim.sensors.samples import Scene


class ContactModel(NamedTuple):
    """Rate in Hz (0: none); our choice."""

    rate: Annotated[float, Range(0.0, 1000.0, "Hz")] = 20.0


class ContactSwitch:
    """One switch for the whole hull: on if the vehicle has touched something since the last sample.

    So even a short contact is reported. The position of the contact is not modelled.
    """

    Model = ContactModel
    topic = "contact"

    def __init__(self, model: ContactModel, mounting: Mounting, seed: int, scene: Scene) -> None:
        self._scene = scene
        self._reported = 0

    def sample(self, time_ns: int, state: State) -> FlagSample:
        """Return whether there was a contact since the last sample."""
        count = self._scene.contacts
        pressed = self._scene.touching or count > self._reported
        self._reported = count
        return FlagSample(time_ns, pressed)
