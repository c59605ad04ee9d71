"""Collect failures of a benchmark's parts, so that results measured before them are not lost."""

from collections.abc import Iterator
from contextlib import contextmanager

from hil.commands.bench.options import show
from hil.common.errors import HilError


class PartialFailures:
    """The errors and the Ctrl-C that ended measurements, reported beside the figures and raised at the end."""

    def __init__(self) -> None:
        self._current = ""
        self._errors: list[tuple[str, HilError | KeyboardInterrupt]] = []

    def begin(self, what: str) -> None:
        """Show what is measured from now on, which failures are reported with."""
        self._current = what
        show(what)

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Store an error that is raised inside; only the `with` block ends, and with it the line of progress."""
        try:
            yield
        except (HilError, KeyboardInterrupt) as error:
            self._errors.append((self._current, error))
        finally:
            show("")

    @property
    def stopped(self) -> bool:
        """True if a person or a signal ended the run: then stop measuring."""
        return any(isinstance(error, KeyboardInterrupt) for _, error in self._errors)

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the labels of figures that are incomplete."""
        return tuple(
            f"RUN FAILED: {place}: {error}" if isinstance(error, HilError) else f"STOPPED: {place}"
            for place, error in self._errors
        )

    def most(self, times: int) -> str:
        """Return the number of repetitions of each figure as text: "5", or "up to 5" after a failure."""
        return f"up to {times}" if self._errors else str(times)

    def raise_first(self) -> None:
        """Raise the first error, if there is one: its exit code is the benchmark's."""
        for _, error in self._errors:
            raise error
