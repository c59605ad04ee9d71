"""Collect failures of a benchmark's parts, so that results measured before them are not lost."""

from collections.abc import Iterator
from contextlib import contextmanager

from hil.common.errors import HilError


class PartialFailures:
    """The errors and the Ctrl-C that ended measurements, which are reported beside the figures and raised at the end.

    `place` is what is being measured; the measuring code keeps it up to date.
    """

    def __init__(self) -> None:
        self.place = ""
        self._found: list[tuple[str, HilError | KeyboardInterrupt]] = []

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Store what is raised inside; it only ends the `with`."""
        try:
            yield
        except (HilError, KeyboardInterrupt) as error:
            self._found.append((self.place, error))

    @property
    def stopped(self) -> bool:
        """True if a person or a signal ended the run: then nothing else is to be measured."""
        return any(isinstance(error, KeyboardInterrupt) for _, error in self._found)

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the labels of figures that are incomplete."""
        return tuple(
            f"RUN FAILED: {place}: {error}" if isinstance(error, HilError) else f"STOPPED: {place}"
            for place, error in self._found
        )

    def most(self, times: int) -> str:
        """Return how many repetitions there are of each figure, in words."""
        return f"up to {times}" if self._found else str(times)

    def raise_first(self) -> None:
        """Raise what ended the first, if anything did: its exit code is that of the benchmark."""
        for _, error in self._found:
            raise error
