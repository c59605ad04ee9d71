"""Starting an autopilot's program: its folder, what PX4 has stored there, and values that PX4 would drop."""

from pathlib import Path

import pytest

from hil.autopilots.program import FlightFolder, _distinct_from_default
from hil.autopilots.px4_files import changed_since, decode_bson, encode_bson, format_for_qgroundcontrol
from hil.common.errors import ConfigError

LISTED = {"CA_AIRFRAME": 7, "UUV_MGM_YAW": 0.3, "UUV_MGM_THRTL": 1.0}


def test_a_folder_keeps_its_files_until_it_is_wiped(tmp_path: Path) -> None:
    path = tmp_path / "vehicle"
    folder = FlightFolder(str(path), wipe=False)
    for name in ("output.txt", "parameters.bson"):
        (path / name).write_text("")
    (path / "log").mkdir()
    with pytest.raises(ConfigError, match="another run uses"):
        FlightFolder(str(path), wipe=True)
    folder.close()
    FlightFolder(str(path), wipe=False).close()
    assert len(list(path.iterdir())) == 3
    FlightFolder(str(path), wipe=True).close()
    assert not list(path.iterdir())
    (path / "thesis.tex").write_text("")
    with pytest.raises(ConfigError, match="no autopilot's folder"):
        FlightFolder(str(path), wipe=True)
    assert (path / "thesis.tex").exists()


def test_px4s_parameter_files_have_types() -> None:
    """The bytes are those of PX4's `param export`; the lines those of QGroundControl: 6 is INT32, 9 is REAL32."""
    data = encode_bson({"CA_AIRFRAME": 7, "UUV_MGM_YAW": 0.5})
    assert data[4:] == b"\x10CA_AIRFRAME\0\7\0\0\0" + b"\1UUV_MGM_YAW\0" + b"\0\0\0\0\0\0\xe0\x3f" + b"\0"
    assert int.from_bytes(data[:4], "little") == len(data)
    assert decode_bson(encode_bson(LISTED)) == LISTED
    assert decode_bson(b"something else") == {}
    assert decode_bson(data[:-9]) == {"CA_AIRFRAME": 7}
    rows = [line.split("\t") for line in format_for_qgroundcontrol(LISTED).splitlines()[3:]]
    assert rows == [
        ["1", "1", "CA_AIRFRAME", "7", "6"],
        ["1", "1", "UUV_MGM_YAW", "0.3", "9"],
        ["1", "1", "UUV_MGM_THRTL", "1.0", "9"],
    ]


def test_values_set_in_px4_are_found_although_it_stores_32_bits() -> None:
    stored = {"UUV_MGM_YAW": 0.30000001192092896, "UUV_MGM_THRTL": 0.5, "CA_AIRFRAME": 7, "COM_RC_IN_MODE": 1}
    assert changed_since(LISTED, stored) == {"UUV_MGM_THRTL": 0.5}


def test_motor_parameters_never_equal_the_firmwares_default() -> None:
    """PX4 drops a value that equals its compiled default, and then the airframe's own default applies."""
    for default in (-1.0, 0.0):
        assert _distinct_from_default("CA_ROTOR5_AZ", default) != default
        assert abs(_distinct_from_default("CA_ROTOR5_AZ", default) - default) < 1e-4
        assert _distinct_from_default("CA_ROTOR11_PX", default) != default
    assert _distinct_from_default("CA_ROTOR0_KM", 0.0) == 0.0
    assert _distinct_from_default("CA_ROTOR_COUNT", 8.0) == 8.0
