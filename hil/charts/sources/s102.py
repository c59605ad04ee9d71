"""Add the uncertainty to S-102 files that have none: edition 3.0 allows this, but GDAL before 3.11 then fails."""

from contextlib import suppress
from typing import Any

import numpy as np

NO_VALUE = 1e6  # S-102's fill value
COVERAGE = "BathymetryCoverage"


def with_uncertainty(path: str) -> bytes | None:
    """Return the S-102 file at `path` with an uncertainty of no value added; None for other files or without h5py."""
    with suppress(ImportError, OSError):
        import h5py

        with h5py.File(path) as source, h5py.File("copy", "w", driver="core", backing_store=False) as target:
            if COVERAGE not in source:
                return None
            target.attrs.update(source.attrs)
            target.create_group("Group_F")  # GDAL recognises S-100 files by it
            _copy(source[COVERAGE], target.create_group(COVERAGE))
            target.flush()
            return bytes(target.id.get_file_image())
    return None


def _copy(source: Any, target: Any) -> None:
    """Copy the attributes, groups and values of group `source` to group `target`, with an uncertainty of no value."""
    target.attrs.update(source.attrs)
    for name, group in source.items():
        if hasattr(group, "items"):
            _copy(group, target.create_group(name))
        elif name == "values" and group.dtype.names and "depth" in group.dtype.names:
            values = np.empty(group.shape, [("depth", "<f4"), ("uncertainty", "<f4")])
            values["depth"], values["uncertainty"] = group["depth"], NO_VALUE
            target.create_dataset(name, data=values)
