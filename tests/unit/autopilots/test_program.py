"""Starting an autopilot's program: values that PX4 would drop are changed slightly."""

from hil.autopilots.program import _distinct_from_default


def test_motor_parameters_never_equal_the_firmwares_default() -> None:
    """PX4 drops a value that equals its compiled default, and then the airframe's own default applies."""
    for default in (-1.0, 0.0):
        assert _distinct_from_default("CA_ROTOR5_AZ", default) != default
        assert abs(_distinct_from_default("CA_ROTOR5_AZ", default) - default) < 1e-4
        assert _distinct_from_default("CA_ROTOR11_PX", default) != default
    assert _distinct_from_default("CA_ROTOR0_KM", 0.0) == 0.0
    assert _distinct_from_default("CA_ROTOR_COUNT", 8.0) == 8.0
