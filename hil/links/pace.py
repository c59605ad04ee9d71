"""Pace commands by their answers: never more of them on the line than it carries.

A line that is slower than the commands stores them: a serial bridge, a radio or a USB adapter has buffers that the
kernel does not know. Without pacing, thousands of bytes wait there, and the STM32 executes commands that are seconds
old. Telemetry echoes the sequence number of a command, so the number of unanswered commands is known.

The window is what the line carries in one round trip without waiting (the bandwidth-delay product, as in BBR, Cardwell
et al. 2016), plus one report. While no answer comes at all, a command is sent every 0.15 s, or sooner where the STM32's
watchdog needs it: lost reports do not stop the thrusters.
"""

from collections import deque

from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S

FIRST_WINDOW = 2  # commands; before the line's rate is known
LEAST_TRIP_NS = 60 * NS_PER_MS  # shorter round trips count as this: on a fast line some reports may be lost
LONGEST_PAUSE_NS = 150 * NS_PER_MS  # between two commands while no answer comes
TRIPS = 2  # shortest round trips in which a report comes
MOST = 256  # commands that are remembered
PROBE = 1.25  # the window is that much larger than what was answered, to find out whether the line carries more
MEASURED_NS = NS_PER_S // 2  # period of one measurement of the rate
UNANSWERED_NS = NS_PER_S  # after this time without any answer since the start, the line counts as one without telemetry
EACH_SHARE = 0.9  # reports for so many of the commands: the STM32 reports each
FORGOTTEN_NS = NS_PER_S // 2  # after this time a command without an answer counts as answered by a lost report
SILENT_NS = 2 * NS_PER_S  # after this time without an answer the line is not slow: the STM32 is silent
SLOW_SHARE = 0.8  # of the commands; a line that carries less counts as slow
LEAST_RATE = 10.0  # commands a second that a line must carry for the vehicle to be armed


class EchoPace:
    """The commands that are on the line.

    `rate`: commands that the line answers a second; `is_slow`: whether that has been less than what was to be sent for
    two measurements; then commands are dropped in favour of newer ones.

    Reports without sequence numbers (`has_sequence` false) name a command by its pulses, which may be equal for many.
    If the STM32 sends a report for each command (`by_count`, or found out while the line carries all), each report
    answers one; a command without an answer for long was answered by a lost report. `watchdog_ns`: that of the STM32.
    """

    def __init__(
        self, has_sequence: bool = True, by_count: bool = False, watchdog_ns: int = 2 * LONGEST_PAUSE_NS
    ) -> None:
        self._pause_ns = min(LONGEST_PAUSE_NS, 3 * watchdog_ns // 4)
        self._has_sequence, self._by_count = has_sequence, by_count and not has_sequence
        self.rate = 0.0
        self.is_slow = False
        self._flight: deque[tuple[int, int]] = deque(maxlen=MOST)  # sequence number, when it was sent (monotonic ns)
        self._window = FIRST_WINDOW
        self._first_ns = self._sent_ns = self._answer_ns = 0
        self._fastest_ns = self._idle_ns = NEVER_NS  # shortest round trip; silence in which a report would have come
        self._batch = 1.0  # commands that one report answers
        self._measured_ns = 0
        self._offered = self._answered = self._reports = 0  # since `_measured_ns`
        self._slow_before = False

    def due_ns(self, now: int) -> int:
        """Return when the next command may be sent if no answer comes; `now` (monotonic ns) or earlier: now."""
        if len(self._flight) < self._window or not self._has_telemetry(now):
            return now
        due_ns = max(self._sent_ns, self._answer_ns) + self._pause_ns
        # Reports that were lost must not count as commands on the line for ever: none came after the last one.
        if self._by_count and self._answer_ns > self._sent_ns and now >= max(due_ns, self._answer_ns + self._idle_ns):
            self._flight.clear()
        return due_ns

    def add_offered(self, now: int) -> None:
        """Count a command that is to be sent at `now`, whether or not the line takes it."""
        self._offered += 1
        if now - self._measured_ns >= MEASURED_NS:
            self._measure(now)

    def add_sent(self, sequence: int, now: int) -> None:
        """Record a command that was written at `now` (monotonic ns)."""
        self._first_ns = self._first_ns or now
        self._sent_ns = now
        self._flight.append((sequence, now))

    def add_answer(self, sequence: int, now: int) -> None:
        """Record a report at `now` (monotonic ns) that echoes a command: this and all before it are answered."""
        self._answer_ns = now
        self._reports += 1
        place = self._find(sequence, now)
        if place is None:  # echoed before, or sent before the link was opened
            return
        self._fastest_ns = min(self._fastest_ns, now - self._flight[place][1])
        self._idle_ns = TRIPS * self._fastest_ns
        for _ in range(place + 1):
            self._flight.popleft()
        self._answered += place + 1
        self._batch = max(place + 1.0, 0.9 * self._batch)
        self._adjust()

    def _find(self, sequence: int, now: int) -> int | None:
        """Return the place of the command that a report answers, in the order of sending; None if it is not there."""
        if not self._by_count:
            return next((i for i, (sent, _) in enumerate(self._flight) if sent == sequence), None)
        while len(self._flight) > 1 and now - self._flight[0][1] > FORGOTTEN_NS:
            self._flight.popleft()
        return 0 if self._flight else None

    def _has_telemetry(self, now: int) -> bool:
        """Return whether answers are to be expected: some came, or it is too early to know."""
        return self._answer_ns > 0 or now - (self._first_ns or now) < UNANSWERED_NS

    def _adjust(self) -> None:
        trip_s = max(self._fastest_ns, LEAST_TRIP_NS) / NS_PER_S
        if self.rate:
            self._window = max(2, round(PROBE * self.rate * trip_s) + round(self._batch))

    def _measure(self, now: int) -> None:
        """Compute the rate of the last period, and whether the line is slow."""
        passed_s = (now - self._measured_ns) / NS_PER_S
        if self._measured_ns and passed_s < 4 * MEASURED_NS / NS_PER_S:  # a longer one has a pause of this process
            self.rate = self._answered / passed_s
            if self._reports >= EACH_SHARE * self._offered > 0:
                self._by_count = not self._has_sequence
            is_answered = now - self._answer_ns < SILENT_NS
            is_slow = is_answered and self._answered < SLOW_SHARE * self._offered
            if is_slow == self._slow_before:
                self.is_slow = is_slow
            self._slow_before = is_slow
        self._measured_ns, self._offered, self._answered, self._reports = now, 0, 0, 0
        self._adjust()
