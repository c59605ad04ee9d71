"""The parameter protocol of MAVLink (PARAM_*). Values travel as floats whatever their type, as ArduPilot sends them."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.parameter_table import GATEWAY, ParameterTable

LONGEST_NAME = 16


class ParameterProtocol:
    """Answers PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET."""

    def __init__(self, table: ParameterTable) -> None:
        self._table = table

    def request_list(self) -> list[Any]:
        """Return PARAM_VALUE of all."""
        names = self._table.names()
        return [self._message(name, index, len(names)) for index, name in enumerate(names)]

    def request_read(self, packet: Any) -> list[Any]:
        """Return PARAM_VALUE of one by name or index, if there is such a parameter."""
        names = self._table.names()
        if packet.param_index < 0:
            return self.value_of(_text(packet.param_id))
        return self.value_of(names[packet.param_index]) if packet.param_index < len(names) else []

    def request_set(self, packet: Any) -> tuple[list[Any], list[tuple[int, str]]]:
        """Set one; return PARAM_VALUE with what it is now, and severity and text of what is to be said about it.

        Of one that the slave is to set it follows when that is done (`value_of`).
        """
        name = _text(packet.param_id)
        reason = self._table.set(name, packet.param_value)
        if not reason and self._table.is_of_slave(name):
            return [], []
        texts = [(4, reason)] if reason else []
        if not reason and GATEWAY[name].group == "stored":
            texts = [(6, f"{name} is stored, and changes nothing in this vehicle")]
        return self.value_of(name), texts

    def value_of(self, name: str) -> list[Any]:
        """Return PARAM_VALUE of one, if there is such a parameter."""
        names = self._table.names()
        return [self._message(name, names.index(name), len(names))] if name in names else []

    def _message(self, name: str, index: int, count: int) -> Any:
        value = self._table.value(name)
        return dialect.MAVLink_param_value_message(
            name.encode("ascii", "replace")[:LONGEST_NAME], 0.0 if value is None else value, self._table.kind(name),
            count, index,
        )  # fmt: skip


def _text(name: str | bytes) -> str:
    """Return a parameter's name as a packet has it."""
    plain = name if isinstance(name, str) else name.decode("ascii", "replace")
    return plain.split("\0", 1)[0]
