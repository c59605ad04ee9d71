"""Part of the build of the wheel: what there is in C goes in where it can be compiled.

Without a compiler the wheel is pure Python and does the same, slower. `UUV_HIL_NATIVE=0` in the environment
builds the pure wheel anyway, `UUV_HIL_NATIVE=1` fails where the C cannot be had.
"""

import os
import runpy
import tempfile
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import sys_tags

BUILD = "c_extensions.py"


class NativeBuildHook(BuildHookInterface[Any]):
    """Compiles the C for a wheel; for `pip install -e`, beside its source."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called by hatchling before it packs; raises RuntimeError if the C is demanded and cannot be had."""
        wish = os.environ.get("UUV_HIL_NATIVE")
        if wish == "0":
            return
        tools = runpy.run_path(os.path.join(self.root, BUILD))
        self._scratch = tempfile.TemporaryDirectory()
        editable = version == "editable"
        folder = self.root if editable else self._scratch.name
        reason = tools["build"](folder)
        if reason:
            if wish == "1":
                raise RuntimeError(f"UUV_HIL_NATIVE=1, but the step in C was not built: {reason}")
            self.app.display_warning(f"the step stays in Python: {reason}")
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"cp310-abi3-{platform()}"
        if not editable:
            for binary in tools["SOURCES"]:
                build_data["force_include"][os.path.join(folder, binary)] = binary

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Called by hatchling when the wheel is written."""
        if hasattr(self, "_scratch"):
            self._scratch.cleanup()


def platform() -> str:
    """The plain Linux tag of this interpreter, such as linux_aarch64: no manylinux is claimed."""
    tags = (tag.platform for tag in sys_tags())
    return next(tag for tag in tags if not tag.startswith(("manylinux", "musllinux")))
