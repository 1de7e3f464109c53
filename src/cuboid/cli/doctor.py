"""`cuboid doctor`: check the requirements of a run."""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import import_module, metadata
from pathlib import Path

from cuboid.cli.results import add_results, give
from cuboid.ground.core.extras import how_to_install
from cuboid.ground.core.threads import cores
from cuboid.ground.version import __version__

EXAMPLE = "cuboid doctor"

# Packages that each run needs: distribution and module ("" if the import writes to the terminal).
PACKAGES = (
    ("numpy", "numpy"),
    ("msgspec", "msgspec"),
    ("scipy", "scipy"),
    ("numba", "numba"),
    ("opencv-contrib-python-headless", "cv2"),
    ("rich", "rich"),
    ("av", "av"),
    ("argcomplete", "argcomplete"),
)
# The packages of each extra; a package may belong to several.
EXTRAS = {
    "synth": (("trimesh", "trimesh"), ("embreex", "embreex")),
    "build": (("hatchling", "hatchling"),),
    "ros": (("rosbags", "rosbags"),),
    "ros2": (("cyclonedds", "cyclonedds"), ("rosbags", "rosbags")),
    "foxglove": (("foxglove-sdk", "foxglove"), ("rosbags", "rosbags")),
    "realsense": (("pyrealsense2", "pyrealsense2"),),
    "oak": (("depthai", ""),),
    "phone": (("openexr", "OpenEXR"), ("pyliblzfse", "liblzfse")),
    "remote": (("fsspec", "fsspec"), ("aiohttp", "aiohttp"), ("s3fs", "s3fs"), ("gcsfs", "")),
    "onnx": (("onnxruntime", "onnxruntime"),),
    "names": (("onnxruntime", "onnxruntime"), ("tokenizers", "tokenizers")),
    "plot": (("matplotlib", "matplotlib"),),
    "rerun": (("rerun-sdk", "rerun"),),
    "shapes": (("scikit-image", "skimage"), ("trimesh", "trimesh"), ("coacd", "coacd")),
    "usd": (("usd-core", "pxr"),),
    "serve": (("starlette", "starlette"), ("uvicorn", "uvicorn"), ("websockets", "websockets")),
    "mcp": (("mcp", "mcp"),),
    "cluster": (
        ("distributed", "distributed"),
        ("pyarrow", "pyarrow"),
        ("duckdb", "duckdb"),
        ("fsspec", "fsspec"),
        ("s3fs", "s3fs"),
        ("starlette", "starlette"),
        ("uvicorn", "uvicorn"),
    ),
}

OK, MISSING, BAD = "ok", "missing", "BAD"


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the report.

    Attributes
    ----------
    name : str
    state : str
        `OK`; `MISSING`: an extra, which only some features need; `BAD`: a run will fail.
    detail : str
    """

    name: str
    state: str
    detail: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Print the checks; return 1 if one of them fails."""
    checks = [
        Check("cuboid", OK, __version__),
        Check("python", OK, f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
        Check("threads", OK, f"{cores()} cores may be used"),
        *_packages(),
        *_kernels(),
        _writable("temporary folder", Path(tempfile.gettempdir())),
    ]
    give(args, {"checks": [asdict(check) for check in checks]}, lambda: _print(checks))
    return 1 if any(check.state == BAD for check in checks) else 0


def _print(checks: list[Check]) -> None:
    width = max(len(check.name) for check in checks)
    for check in checks:
        print(f"{check.state:7} {check.name:{width}}  {check.detail}")


def _packages() -> Iterator[Check]:
    for distribution, module in PACKAGES:
        try:
            yield Check(distribution, OK, _version(distribution, module))
        except ImportError as error:
            yield Check(distribution, BAD, f"cannot be imported: {error}")
    yield _opencv_parts()
    for extra, packages in EXTRAS.items():
        yield _extra(extra, packages)


def _extra(extra: str, packages: tuple[tuple[str, str], ...]) -> Check:
    """Check all packages of an extra."""
    versions, missing = [], []
    for distribution, module in packages:
        try:
            versions.append(f"{distribution} {_version(distribution, module)}")
        except ImportError:
            missing.append(distribution)
    name = f"extra {extra}"
    if missing:
        return Check(name, MISSING, f"needs {', '.join(missing)}: {how_to_install(extra)}")
    return Check(name, OK, ", ".join(versions))


def _version(distribution: str, module: str) -> str:
    """Return the version of a package; raises ImportError if it is not installed or does not load."""
    if module:
        import_module(module)
    return metadata.version(distribution)  # its PackageNotFoundError is an ImportError


def _opencv_parts() -> Check:
    """Check the parts that only the contrib build of OpenCV has; another build may have overwritten it."""
    try:
        import cv2

        missing = [part for part in ("ximgproc", "saliency") if not hasattr(cv2, part)]
    except ImportError:
        missing = ["all of it"]
    detail = (
        f"lacks {', '.join(missing)}: another OpenCV package overwrote the contrib one; reinstall it"
        if missing
        else "ximgproc, saliency"
    )
    return Check("opencv contrib", BAD if missing else OK, detail)


def _kernels() -> Iterator[Check]:
    try:
        import_module("cuboid.runs.tracking.posed_tracker")
    except ImportError as error:
        yield Check("kernels", BAD, f"the tracker cannot be imported: {error}")
        return
    from cuboid.ground.compiling.compiled import KERNELS
    from cuboid.ground.compiling.kernelcache import cache_folder

    ready = sum(kernel.cached for kernel in KERNELS.values())
    rest = "" if ready == len(KERNELS) else "; the others when they are first used, or now by 'cuboid compile'"
    installed = sum(kernel.cache.installed for kernel in KERNELS.values())
    came = f", {installed} with the installation" if installed else ""
    yield Check("kernels", OK, f"{ready} of {len(KERNELS)} compiled{came}{rest}")
    yield _writable("kernel cache", cache_folder())


def _writable(name: str, folder: Path) -> Check:
    at = folder
    while not at.exists() and at != at.parent:  # the first write creates the cache
        at = at.parent
    try:
        with tempfile.TemporaryFile(dir=at):
            pass
    except OSError as error:
        return Check(name, BAD, f"{folder}: cannot be written: {error.strerror}")
    return Check(name, OK if os.access(at, os.X_OK) else BAD, str(folder))
