"""The footer of a benchmark's picture."""

from hil.bench.record import Record


def footer(record: Record) -> str:
    """Return where and when it was measured, and what its figures stand for."""
    machine = record.machine
    where = f"{machine['name']}: {machine['board'] or machine['cpu']}, {machine['usable_cores']} processors"
    return "\n".join([f"{where}; {record.made}", "; ".join(record.labels)]).strip()
