"""The footer of a benchmark's picture."""

from hil.bench.record import Record


def footer(record: Record) -> str:
    """Return machine, date and labels of the figures, as text."""
    machine = record.machine
    where = f"{machine['name']}: {machine['board'] or machine['cpu']}, {machine['usable_cores']} processors"
    return "\n".join([f"{where}; {record.made}", "; ".join(record.labels)]).strip()
