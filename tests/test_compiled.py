from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from numba import types

from cuboid.cli import main
from cuboid.cli.parser import MISTAKE
from cuboid.ground import locks
from cuboid.ground.compiling import compiletime, kernelcache
from cuboid.ground.compiling.compiled import KERNELS
from cuboid.ground.compiling.kernelcache import KEPT_VERSIONS, UNUSED_S, cache_folder, prune
from cuboid.ground.compiling.kernelstamp import stamp_of
from cuboid.ground.compiling.signatures import decode, encode
from cuboid.ground.core.kernels.regions import Borders
from cuboid.runs.pipeline import ahead

SOURCE = """
from typing import NamedTuple
import numpy as np
from cuboid.ground.compiling.compiled import kernel

FACTOR = 2.0
TABLE = np.array([1, 2])

class Pair(NamedTuple):
    first: object
    second: object

@kernel(inline="always")
def inlined(x):
    return x + 1.0

@kernel
def called(x):
    return FACTOR * inlined(x)

@kernel
def outer(x):
    '''Doc.'''
    return called(x) + TABLE[0]

@kernel
def other(pair):
    return pair.first - pair.second
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return an empty folder of compiled kernels."""
    monkeypatch.setenv(kernelcache.VARIABLE, str(tmp_path / "kernels"))
    cache_folder.cache_clear()
    yield tmp_path / "kernels"
    cache_folder.cache_clear()


def module(source: str = SOURCE, *changes: tuple[str, str]) -> Any:
    """Return a module as a new process would import it."""
    for before, after in changes:
        assert before in source
        source = source.replace(before, after)
    made = ModuleType("made_kernels")
    made.__spec__ = sys.__spec__
    sys.modules["made_kernels"] = made
    exec(compile(source, "made_kernels.py", "exec"), made.__dict__)
    return made


def stamps(*changes: tuple[str, str]) -> dict[str, str]:
    """Return the stamp of each kernel of the source, changed or not."""
    made = module(SOURCE, *changes)
    kernels = (made.called, made.outer, made.other)
    return {one.py_func.__name__: stamp_of(one.py_func, one.targetoptions) for one in kernels}


@pytest.mark.parametrize(
    ("change", "changed"),
    [
        (("FACTOR = 2.0", "FACTOR = 3.0"), {"called", "outer"}),
        (("FACTOR = 2.0", "FACTOR = 2"), {"called", "outer"}),
        (("x + 1.0", "x + 1.5"), {"called", "outer"}),
        (("[1, 2]", "[1, 3]"), {"outer"}),
        (("[1, 2]", "[1.0, 2]"), {"outer"}),
        (("pair.first - pair.second", "pair.second - pair.first"), {"other"}),
        (("@kernel\ndef called", "@kernel(error_model='numpy')\ndef called"), {"called", "outer"}),
        (("Doc.", "Another."), set()),
        (("FACTOR = 2.0", "# A comment.\n\nFACTOR = 2.0"), set()),
    ],
)
def test_a_stamp_changes_with_all_that_a_kernel_is_made_of_and_with_nothing_else(
    change: tuple[str, str], changed: set[str]
) -> None:
    before, after = stamps(), stamps(change)
    assert {name for name in before if before[name] != after[name]} == changed


def test_a_kernel_may_not_use_a_module_of_ours() -> None:
    made = module("from cuboid.ground.core import tolerances\n" + SOURCE, ("pair.first -", "tolerances.JUMP_M -"))
    with pytest.raises(TypeError, match=r"made_kernels\.other: tolerances: a kernel uses a module"):
        stamp_of(made.other.py_func, {})


def compiled(name: str) -> bool:
    return KERNELS[f"made_kernels.{name}"].cache.compiled


def test_an_edited_constant_is_never_answered_from_the_cache_and_the_rest_stays_compiled(folder: Path) -> None:
    made = module()
    assert (made.outer(1.0), made.other(made.Pair(3.0, 2.0))) == (5.0, 1.0)
    assert compiled("outer")
    assert compiled("other")
    made = module(SOURCE, ("FACTOR = 2.0", "FACTOR = 3.0"))
    assert (made.outer(1.0), made.other(made.Pair(3.0, 2.0))) == (7.0, 1.0)
    assert compiled("outer")
    assert not compiled("other")
    made = module()  # the edit is taken back
    assert made.outer(1.0) == 5.0
    assert not compiled("outer")


def test_the_order_of_a_named_tuples_fields_counts(folder: Path) -> None:
    made = module()
    assert made.other(made.Pair(3.0, 2.0)) == 1.0
    made = module(SOURCE, ("    first: object\n    second: object", "    second: object\n    first: object"))
    assert made.other(made.Pair(3.0, 2.0)) == -1.0


def test_a_kernel_that_is_compiled_anew_uses_those_that_are_loaded(folder: Path) -> None:
    module().outer(1.0)
    made = module(SOURCE, ("TABLE = np.array([1, 2])", "TABLE = np.array([6, 2])"))
    assert made.called(1.0) == 4.0
    assert made.outer(1.0) == 10.0
    assert (compiled("called"), compiled("outer")) == (False, True)


LOADED = """
import sys
import made_kernels
assert made_kernels.outer(1.0) == 5.0
try:
    made_kernels.room(-1)
except ValueError as error:
    print(error)
print(made_kernels.room(3), made_kernels.highest(made_kernels.room(3)))
print(*(name for name in ("scipy.linalg", "numba.np.arraymath") if name in sys.modules))
"""


def test_a_loaded_kernel_needs_nothing_of_the_compiler(tmp_path: Path, folder: Path) -> None:
    more = "@kernel\ndef room(n):\n    return np.zeros(n)\n\n@kernel\ndef highest(a):\n    return a.argmax()\n"
    (tmp_path / "made_kernels.py").write_text(SOURCE + more)
    said = [
        subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True, cwd=tmp_path).stdout
        for _ in range(2)
    ]
    fault, answer, imported = said[1].splitlines()
    assert said[0].splitlines()[:2] == [fault, answer]
    assert fault == "negative dimensions not allowed"
    assert answer == "[0. 0. 0.] 0"
    assert not imported


def test_a_damaged_file_is_compiled_again(folder: Path) -> None:
    module().outer(1.0)
    for path in folder.iterdir():
        path.write_bytes(path.read_bytes()[:-20] if path.suffix == ".nbc" else b"\x80")
    made = module()
    assert made.outer(1.0) == 5.0
    assert compiled("outer")
    made = module()
    assert made.outer(1.0) == 5.0
    assert not compiled("outer")


def test_a_cache_that_cannot_be_written_ends_no_run(tmp_path: Path, folder: Path) -> None:
    folder.write_text("a file where the folder should be")
    assert module().outer(1.0) == 5.0


def test_old_files_are_removed(folder: Path) -> None:
    folder.mkdir()
    ages_s = {"a.f-new": 0.0, "b.g-unused": UNUSED_S + 60.0, "b.g-used": UNUSED_S - 60.0}
    ages_s |= {f"a.f-{age}": 3600.0 * age for age in range(1, KEPT_VERSIONS + 3)}
    newest = cache_time(folder)
    for name, age_s in ages_s.items():
        for path in (folder / f"{name}.nbi", folder / f"{name}.1.nbc"):
            path.touch()
            os.utime(path, (newest - age_s, newest - age_s))
    prune("a.f", folder / "a.f-new.nbi")
    kept = {"a.f-new", "b.g-used", *(f"a.f-{age}" for age in range(1, KEPT_VERSIONS + 1))}
    assert {path.name for path in folder.iterdir()} == {f"{name}.{end}" for name in kept for end in ("nbi", "1.nbc")}


def cache_time(folder: Path) -> float:
    """Return the time of the file system, now."""
    probe = folder / "probe"
    probe.touch()
    now_s = probe.stat().st_mtime
    probe.unlink()
    return now_s


def test_the_working_clock_stands_still_while_kernels_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr(compiletime.time, "perf_counter", lambda: now_s)
    begun_s, compiled_s = compiletime.working_s(), compiletime.compiling_s()
    now_s += 1.0
    compiletime.begin()
    now_s += 5.0
    compiletime.begin()  # a kernel that the first one calls
    now_s += 2.0
    assert compiletime.working_s() - begun_s == pytest.approx(1.0)
    compiletime.end()
    compiletime.end()
    now_s += 0.5
    assert compiletime.working_s() - begun_s == pytest.approx(1.5)
    assert compiletime.compiling_s() - compiled_s == pytest.approx(7.0)


def test_compiling_a_kernel_is_timed_and_told(folder: Path) -> None:
    told: list[bool] = []
    before_s = compiletime.compiling_s()
    with compiletime.listening(lambda: told.append(compiletime.compiling())):
        module().outer(1.0)
    assert told[0]
    assert not told[-1]
    assert compiletime.compiling_s() > before_s


def test_a_kernel_that_another_process_compiles_is_awaited_and_loaded(folder: Path) -> None:
    module().outer(1.0)
    made = module()
    cache = KERNELS["made_kernels.outer"].cache
    hidden = cache.index.rename(folder / "hidden")
    handle = locks.lock_file(folder / f"{cache.index.stem}.lock")
    assert cache.busy
    with ThreadPoolExecutor() as pool:
        called = pool.submit(made.outer, 1.0)
        time.sleep(0.2)
        assert not called.done()
        hidden.rename(cache.index)
        locks.release(handle, folder / f"{cache.index.stem}.lock")
        assert called.result() == 5.0
    assert not compiled("outer")
    assert not cache.busy
    assert not list(folder.glob("*.lock"))


def test_a_process_that_stands_still_is_not_awaited_for_ever(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernelcache, "MAX_WAIT_S", 0.1)
    made = module()
    folder.mkdir()
    path = folder / f"{KERNELS['made_kernels.outer'].cache.index.stem}.lock"
    handle = locks.lock_file(path)
    assert made.outer(1.0) == 5.0
    assert compiled("outer")
    locks.release(handle, path)


def test_types_become_json_and_back() -> None:
    items = (types.float32[:, ::1], types.int64, types.boolean, types.Array(types.int32, 2, "F"))
    pair = types.NamedTuple(items, Borders)
    for value in (
        types.float64,
        types.boolean,
        types.uint8[:, :, ::1],
        types.float32[:],
        pair,
        types.UniTuple(pair, 2),
    ):
        assert decode(json.loads(json.dumps(encode(value)))) == value
    with pytest.raises(TypeError, match="no JSON for the type"):
        encode(types.unicode_type)


@dataclass
class FakeKernel:
    cached: bool


@pytest.mark.parametrize(
    ("missing", "processes", "helpers"),
    [
        (ahead.MIN_MISSING, 2, 1),
        (ahead.MIN_MISSING, 64, ahead.MAX_PROCESSES - 1),
        (ahead.MIN_MISSING, 1, 0),
        (ahead.MIN_MISSING - 1, 4, 0),
    ],
)
def test_other_processes_help_where_many_kernels_are_missing(
    monkeypatch: pytest.MonkeyPatch, missing: int, processes: int, helpers: int
) -> None:
    monkeypatch.setattr(ahead, "listed_kernels", lambda: [FakeKernel(k >= missing) for k in range(80)])
    monkeypatch.setattr(ahead, "is_writable", lambda: True)
    assert ahead.useful_helpers(processes) == helpers


def test_no_other_process_helps_where_nothing_can_be_stored(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "listed_kernels", lambda: [FakeKernel(cached=False)] * ahead.MIN_MISSING)
    folder.write_text("a file where the folder should be")
    assert ahead.useful_helpers(4) == 0


def test_compiling_ahead_into_a_folder_that_cannot_be_written_is_a_mistake(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ahead, "listed_kernels", lambda: [FakeKernel(cached=False)])
    folder.write_text("a file where the folder should be")
    assert main(["compile"]) == MISTAKE
    assert f"{folder}: compiled kernels cannot be stored here" in capsys.readouterr().err


def test_a_kernel_that_another_process_compiles_is_awaited_at_the_end(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module()
    cache = KERNELS["made_kernels.outer"].cache
    monkeypatch.setattr(ahead, "listed", lambda: [("made_kernels.outer", ["float64"])])
    folder.mkdir()
    path = folder / f"{cache.index.stem}.lock"
    handle = locks.lock_file(path)
    ahead.compile_listed()
    assert not cache.index.exists()
    with ThreadPoolExecutor() as pool:
        done = pool.submit(ahead.compile_all)
        time.sleep(0.2)
        assert not done.done()
        locks.release(handle, path)
        done.result()
    assert cache.index.exists()


def test_helpers_end_with_the_work_that_they_help() -> None:
    with ahead.helpers(2) as running:
        assert len(running) == 2
    assert all(process.returncode is not None for process in running)


def test_listed_kernels_are_compiled_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    last = ahead.listed()[-2:]
    monkeypatch.setattr(ahead, "listed", lambda: last)
    told: list[tuple[int, int]] = []
    ahead.compile_listed(0.5, lambda done, total: told.append((done, total)))
    assert told == [(0, 2), (1, 2), (2, 2)]
    assert all(KERNELS[name].cached for name, _ in last)


def test_the_list_of_kernels_is_that_of_tracking() -> None:
    """If this fails, run `benchmarks/list_kernels.py`."""
    script = Path(__file__).resolve().parents[1] / "benchmarks" / "list_kernels.py"
    done = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
