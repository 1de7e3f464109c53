"""The oldest processor on which kernels run that were compiled at the installation.

A wheel may go to another computer. Its kernels are therefore compiled for this processor and not for that of the
computer that builds the wheel, and are used only where the processor has all that they need.
"""

from __future__ import annotations

import platform
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from llvmlite import binding

# The folder of the compiled kernels in a wheel. A checkout, and a wheel without compiled kernels, do not have it.
FOLDER = Path(__file__).with_name("machine_code")


@dataclass(frozen=True, slots=True)
class Baseline:
    """A processor for which kernels are compiled.

    Attributes
    ----------
    cpu : str
        LLVM's name of the processor.
    needs : tuple of str
        LLVM's names of the instruction sets that the compiled kernels may use, beyond those of every processor of this
        architecture.
    """

    cpu: str
    needs: tuple[str, ...] = ()

    @property
    def environment(self) -> dict[str, str]:
        """The environment variables that let numba compile for this processor."""
        return {"NUMBA_CPU_NAME": self.cpu, "NUMBA_CPU_FEATURES": ""}


# The level v3 of x86-64: Intel since 2013, AMD since 2015; https://gitlab.com/x86-psABIs/x86-64-ABI, table 3.1.
_X86_64 = Baseline("x86-64-v3", ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"))
_ARM_64 = Baseline("generic")
BASELINES = {"x86_64": _X86_64, "amd64": _X86_64, "aarch64": _ARM_64, "arm64": _ARM_64}


def baseline() -> Baseline | None:
    """Return the baseline of this computer's architecture; None if there is none."""
    return BASELINES.get(platform.machine().lower())


@cache
def usable_baseline() -> Baseline | None:
    """Return the baseline if the installation has compiled kernels and this processor can run them; else None."""
    found = baseline()
    if found is None or not FOLDER.is_dir():
        return None
    try:
        features = binding.get_host_cpu_features() if found.needs else {}
    except RuntimeError:  # LLVM does not know the processor
        return None
    return found if all(features.get(name, False) for name in found.needs) else None
