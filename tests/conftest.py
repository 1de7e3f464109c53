from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from allowed_skips import may_be_skipped
from slow_files import SLOW_FILES

# The same examples in every run; the first one of a kernel also compiles it, which no deadline allows for.
settings.register_profile("cuboid", deadline=None, derandomize=True)
settings.load_profile("cuboid")

# A shell starts jobs in the background with Ctrl-C ignored; commands under test would inherit that and never end.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Each command under test is a process of its own; without byte code it would compile all modules again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

REPOSITORY = Path(__file__).resolve().parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--fast`."""
    parser.addoption("--fast", action="store_true", help="leave out the files of tests/slow_files.py")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out slow files where `--fast` is given."""
    fast = config.getoption("--fast") and collection_path.suffix == ".py"
    return True if fast and str(collection_path.relative_to(REPOSITORY / "tests")) in SLOW_FILES else None


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int | None:
    """Return a process more than there are cores: many tests wait, for servers, browsers and killed runs."""
    given = "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ
    return None if given else (os.cpu_count() or 1) + 1


def pytest_configure(config: pytest.Config) -> None:
    """Keep the order of files that is set below, and compile the kernels of tracking on all cores.

    pytest-xdist would begin with the files of most tests.
    """
    config.option.loadscopereorder = False
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        # Otherwise each process of the tests would wait for the others' kernels, one after the other.
        subprocess.run([sys.executable, "-m", "cuboid", "compile"], check=False, stdout=subprocess.DEVNULL)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the slow files, so that the fast ones keep all processes busy up to the end."""
    items.sort(key=lambda item: str(item.path.relative_to(REPOSITORY / "tests")) not in SLOW_FILES)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of the real recordings; without them the test skips, in CI it fails."""
    folder = Path(os.environ.get("CUBOID_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        message = f"no real recordings at {folder} (set CUBOID_DATA to their folder)"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    return folder


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """A function that calls a command which is refused, and returns the one line that says why."""
    from cuboid.cli import main

    def call(*words: object) -> str:
        assert main([*map(str, words)]) == 2, words
        out, line = capsys.readouterr()
        assert (out, line.count("\n")) == ("", 1)
        assert line.startswith("cuboid: error: ")
        return line

    return call


@pytest.fixture(scope="module")
def launched() -> Generator[Any, None, None]:
    """A browser."""
    from browser import browser

    with browser() as found:
        yield found


@pytest.fixture
def open_page(launched: Any) -> Generator[Any, None, None]:
    """A function that opens pages, which must not have complained in the end."""
    from browser import OpenPage

    opener = OpenPage(launched)
    yield opener
    opener.close()


@pytest.fixture(scope="session")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an image-text model that knows colors."""
    from made_text_models import made_text_model

    return made_text_model(tmp_path_factory.mktemp("text") / "model")


def _refuse_skip(report: pytest.CollectReport | pytest.TestReport) -> None:
    """Make a skip in CI a failure, unless it is an allowed one; an expected failure is none."""
    if (
        os.environ.get("CI")
        and report.skipped
        and not hasattr(report, "wasxfail")
        and not may_be_skipped(report.nodeid)
    ):
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid} is skipped, which tests/allowed_skips.py does not allow: {report.longrepr}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Hold a test that is skipped against the list."""
    report = yield
    _refuse_skip(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Hold a file that is skipped against the list."""
    report = yield
    _refuse_skip(report)
    return report
