"""Compile the kernels of tracking while a wheel is built, so that the first run of an installed Cuboid need not.

The packages of `requirements/run.txt` must be there: build with pip's `--no-build-isolation`, or `--no-isolation` of
`build`. Without them, or with `HATCH_BUILD_NO_HOOKS=true`, the wheel has no compiled kernels, and the first run
compiles them. A checkout that is installed with `-e` has none, since its kernels change.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

# Compile all kernels of tracking for the oldest processor that the wheel supports, and those of made recordings, if the
# extra `synth` is there. Print the folder of the wheel to which they belong. It fails if a package is missing, or on
# another kind of processor.
COMPILE = """
import os
from contextlib import suppress
from cuboid.ground.compiling.baseline import FOLDER, baseline
processor = baseline()
if processor is None:
    raise SystemExit("there is no common kind of this computer's processor")
os.environ.update(processor.environment)
import cuboid
from cuboid.cli import main
if main(["compile", "--json"]) != 0:
    raise SystemExit("the kernels cannot be compiled")
with suppress(ImportError):
    main("synth --kind table --frames 1 --size 160x120 --output made".split())
print(FOLDER.relative_to(os.path.dirname(os.path.dirname(cuboid.__file__))).as_posix())
"""


class KernelHook(BuildHookInterface[Any]):
    """Adds the compiled kernels to a wheel."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the kernels into a temporary folder and add its files to the wheel."""
        if version == "editable":
            return
        self._folder = Path(tempfile.mkdtemp(prefix="cuboid-build-"))
        environment = {**os.environ, "PYTHONPATH": str(Path(self.root, "src")), "NUMBA_CACHE_DIR": str(self._folder)}
        words = [sys.executable, "-c", COMPILE]
        done = subprocess.run(words, env=environment, cwd=self._folder, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            shutil.rmtree(self._folder, ignore_errors=True)
            reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
            self.app.display_warning(f"the wheel has no compiled kernels; the first run compiles them ({reason})")
            return
        target = done.stdout.splitlines()[-1]
        for file in sorted(self._folder.glob("*.nb?")):
            build_data["force_include"][str(file)] = f"{target}/{file.name}"
        build_data["pure_python"] = False
        build_data["infer_tag"] = True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder."""
        if version != "editable":
            shutil.rmtree(self._folder, ignore_errors=True)
