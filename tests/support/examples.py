"""Number of random examples of a test, and suppressed health checks; `tests/conftest.py` has the profiles.

The default profile draws the same examples each time: a failure is the same for everybody. `make search`, a part of
`make check`, draws eight times as many from a seed that can be chosen.
"""

from hypothesis import HealthCheck, settings

USUAL = 100
# How long it takes to draw examples is a matter of what else the machine does.
_MACHINE = (HealthCheck.too_slow,)


def register_profiles() -> None:
    """Register the profiles, and load the default one for all modules imported from now on."""
    common = settings(deadline=None, database=None, suppress_health_check=_MACHINE, print_blob=True)
    settings.register_profile("default", common, derandomize=True, max_examples=USUAL // 4)
    settings.register_profile("search", common, derandomize=False, max_examples=2 * USUAL)
    settings.load_profile("default")


def examples(number: int, *unhealthy: HealthCheck) -> settings:
    """Return settings for a test of `number` examples, multiplied by the factor of the profile."""
    return settings(
        max_examples=number * settings().max_examples // USUAL, suppress_health_check=(*_MACHINE, *unhealthy)
    )
