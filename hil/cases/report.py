"""Write the report of cases: what the paper shows, and the results measured here."""

import os
from collections.abc import Sequence

from hil.cases import fidelity, table
from hil.cases.case import Case, find_case
from hil.cases.record import Result, Run
from hil.common.tables import save_text
from hil.master.recorder import make_folder

Flights = dict[str, list[Run]]  # by case


def write_report(path: str, flights: Flights, pictures: str, head: str = "# Cases\n") -> list[str]:
    """Write the report to `path` and a picture of each case to the folder `pictures`; return the files written.

    Raises ConfigError, MissingExtraError.
    """
    make_folder(pictures)
    results = [run.result for runs in flights.values() for run in runs]
    parts = [head, table.markdown(list(zip(*table.summary(results), strict=True))), *_failures(results)]
    files = [path]
    picture_folder = os.path.relpath(pictures, os.path.dirname(path) or ".")
    for name, runs in flights.items():
        case = find_case(name)
        figure = os.path.join(pictures, f"{name}.png")
        case.draw(_pair(runs) or runs[:1], figure)
        files.append(figure)
        picture = os.path.join(picture_folder, os.path.basename(figure))
        parts += [*_about(case, runs), f"![{case.about['title']}]({picture})"]
    save_text(path, "\n\n".join(part.strip("\n") for part in parts) + "\n")
    return files


def _about(case: Case, runs: Sequence[Run]) -> list[str]:
    about = case.about
    parts = [f"## {about['title']}", f"**The paper.** {about['paper']}"]
    parts += [f"**This project.** {about['method']}."] if "method" in about else []
    parts.append(f"**Criterion of success.** {about['criterion']}.")
    extra = _extra([run.result for run in runs])
    if extra:
        parts += ["**Figures of this case**, over all its flights:", table.markdown(extra)]
    pair = _pair(runs)
    if pair:
        parts.append("**SIL and HIL side by side**, the same files, planner and seed:")
        parts.append(table.markdown(fidelity.rows(*pair)))
    return parts


def _pair(runs: Sequence[Run]) -> tuple[Run, Run] | None:
    """Return a SIL and a HIL flight of the same seed, None if there are none."""
    sil = {run.result.seed: run for run in runs if run.result.mode == "sil"}
    pairs = [(sil[run.result.seed], run) for run in runs if run.result.mode == "hil" and run.result.seed in sil]
    return pairs[0] if pairs else None


def _extra(results: Sequence[Result]) -> list[list[str]]:
    """Return the rows of the results that only this case has, headings first; empty if it has none."""
    names = list(dict.fromkeys(name for result in results for name in result.extra))
    rows = [["Figure", "Least", "Greatest"]]
    for name in names:
        values = [result.extra[name] for result in results if name in result.extra]
        rows.append([name, f"{min(values):.3g}", f"{max(values):.3g}"])
    return rows if names else []


def _failures(results: Sequence[Result]) -> list[str]:
    failed = [f"- {line}" for line in table.failures(results)]
    return ["What failed:\n\n" + "\n".join(failed)] if failed else []
