"""The commands where the world around them is not as usual: full, closed, read-only, without a home."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from commands import at_most, bound, command, contents, refused, run, run_here

from fakes import write_recording

SOURCE = Path(__file__).resolve().parents[2] / "src"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("surroundings") / "recording", 12)


@pytest.fixture(scope="module")
def tracked(recording: Path) -> Path:
    assert run_here("track", recording, "--output", recording.parent / "out").returncode == 0
    return recording.parent / "out"


@pytest.fixture
def results(tracked: Path, tmp_path: Path) -> Path:
    return shutil.copytree(tracked, tmp_path / "out")


@pytest.mark.parametrize(
    "words",
    [
        ("track", "RECORDING", "--output", "OUT", "--force"),
        ("track", "RECORDING", "--output", "OUT", "--force", "--video"),
        ("report", "OUT", "--force"),
        ("render", "OUT", "--force"),
        ("export", "OUT", "--to", "json", "--output", "OUT.json", "--force"),
        ("export", "OUT", "--to", "ply", "--output", "OUT-ply", "--force"),
        ("evaluate", "OUT", "truth.json", "--json", "OUT.json", "--force"),
    ],
    ids=lambda words: " ".join(words[:1] + words[3:4]),
)
def test_a_full_disk_leaves_what_was_there(results: Path, recording: Path, words: tuple[str, ...]) -> None:
    (results.parent / "truth.json").write_text('{"format": "cuboid-truth", "version": 1, "objects": []}')
    (results.parent / "out.json").write_text("old")
    before = contents(results.parent)
    named = {"OUT": results, "RECORDING": recording, "OUT.json": results.parent / "out.json"}
    named |= {"OUT-ply": results.parent / "out-ply", "truth.json": results.parent / "truth.json"}
    with at_most(300):
        done = run_here(*(named.get(word, word) for word in words))
    assert "cannot be written" in refused(done)
    assert contents(results.parent) == before


@pytest.mark.parametrize("force", [False, True])
def test_a_folder_that_cannot_be_written_is_one_line(results: Path, recording: Path, force: bool) -> None:
    before = contents(results)
    place = results if force else results.parent
    place.chmod(0o555)
    try:
        out = results if force else results.parent / "new"
        words = bound(command("track", recording, "--output", out, *(["--force"] if force else [])))
        assert "Permission denied" in refused(run(words))
        if force:
            assert "Permission denied" in refused(run(bound(command("report", results, "--force"))))
        assert run(bound(command("export", results, "--to", "csv", "--output", results / "x.csv"))).returncode == (
            2 if force else 0
        )
    finally:
        place.chmod(0o755)
        (results / "x.csv").unlink(missing_ok=True)
    assert {**before, "report.html": ""} == {**contents(results), "report.html": ""}


def test_what_may_not_be_read_is_one_line(results: Path, recording: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(recording, copy)
    (results / "tracks.csv").chmod(0)
    (copy / "camera.json").chmod(0)
    assert "tracks.csv: cannot be read: Permission denied" in refused(run(bound(command("report", results, "--force"))))
    assert "camera.json: cannot be read: Permission denied" in refused(
        run(bound(command("track", copy, "--output", tmp_path / "new")))
    )
    (copy / "color").chmod(0)
    assert "cannot be read: Permission denied" in refused(
        run(bound(command("track", copy, "--output", tmp_path / "new")))
    )
    (copy / "color").chmod(0o755)


def test_an_output_on_a_file_or_inside_the_recording_spoils_neither(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("precious")
    assert "is a file" in refused(run_here("track", recording, "--output", tmp_path / "file", "--force"))
    assert (tmp_path / "file").read_text() == "precious"
    before = contents(recording)
    refused(run_here("track", recording, "--output", recording, "--force"))
    assert contents(recording) == before
    for place in ("results", "color"):
        out = recording / place
        done = run_here("track", recording, "--output", out, *(["--force"] if out.exists() else []))
        assert done.returncode == 0, done.stderr
        assert {name: digest for name, digest in contents(recording).items() if name in before} == before
        again = run_here("track", recording, "--output", tmp_path / place)
        assert "12 of 12 frames" in again.stdout, again.stderr
    shutil.rmtree(recording / "results")


def test_an_output_on_what_is_no_file_leaves_it_there(results: Path, tmp_path: Path) -> None:
    """Root could replace a device, which all programs of the machine use."""
    os.mkfifo(tmp_path / "pipe.json")
    os.symlink("/dev/null", tmp_path / "link.json")
    truth = tmp_path / "truth.json"
    truth.write_text('{"format": "cuboid-truth", "version": 1, "objects": []}')
    for place in (tmp_path / "pipe.json", tmp_path / "link.json"):
        before = os.lstat(place)
        for words in (
            ("evaluate", results, truth, "--json", place),
            ("export", results, "--to", "json", "--output", place, "--force"),
        ):
            assert "the output must be a file" in refused(run_here(*words)), words
        assert os.lstat(place).st_ino == before.st_ino
    assert "is a device" in refused(run(command("evaluate", results, truth, "--json=/dev/stdout")))


def test_an_output_on_a_circle_of_links_is_refused_or_takes_its_place(
    recording: Path, results: Path, tmp_path: Path
) -> None:
    place = tmp_path / "circle.ply"
    place.symlink_to(place.name)
    for words in (
        ("track", recording, "--output", place),
        ("convert", recording, "--to", "plain", "--output", place),
        ("export", results, "--to", "ply", "--output", place),
    ):
        done = run_here(*words)
        assert done.returncode in (0, 2), done.stderr
        if done.returncode:
            refused(done)


def closing(*numbers: int) -> Callable[[], None]:
    def close() -> None:
        for number in numbers:
            os.close(number)

    return close


@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)], ids=["stdout", "stderr", "all"])
def test_closed_streams_change_nothing_of_the_results(recording: Path, tmp_path: Path, closed: tuple[int, ...]) -> None:
    out = tmp_path / "out"
    words = command("track", recording, "--output", out)
    done = subprocess.run(words, preexec_fn=closing(*closed), stdout=None, stderr=None, timeout=60, check=False)
    assert done.returncode == 0
    assert (out / "tracks.csv").read_text().startswith("frame,")
    assert not any(b"; results in" in path.read_bytes() for path in out.iterdir())


def test_a_full_standard_output_is_one_line(results: Path) -> None:
    with open("/dev/full", "w") as full:
        line = refused(run(command("doctor"), stdout=full))
        assert "standard output cannot be written" in line
        truth = results.parent / "truth.json"
        truth.write_text('{"format": "cuboid-truth", "version": 1, "objects": []}')
        assert "standard output" in refused(run(command("evaluate", results, truth), stdout=full))


def surroundings() -> Iterator[dict[str, str]]:
    base = {name: value for name, value in os.environ.items() if name not in ("HOME", "LANG", "LC_ALL", "TERM")}
    yield {**base, "LANG": "C"}
    yield {**base, "LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    yield {**base, "HOME": "/proc/nowhere", "TERM": "dumb", "COLUMNS": "1"}
    yield {**base, "PYTHONIOENCODING": "ascii"}


@pytest.mark.parametrize("environment", list(surroundings()), ids=["C", "POSIX", "no home", "ascii"])
def test_poor_surroundings_are_enough(recording: Path, tmp_path: Path, environment: dict[str, str]) -> None:
    odd = tmp_path / "Küche \udcff\x1b[31m"
    os.symlink(recording, odd)
    done = run(command("track", odd, "--output", tmp_path / "out é"), env=environment)
    assert done.returncode == 0, done.stderr
    assert "12 of 12 frames" in done.stdout
    assert "\x1b" not in done.stdout + done.stderr


def test_kernels_are_kept_in_the_cache_of_the_user_or_else_in_the_temporary_folder(tmp_path: Path) -> None:
    copy = tmp_path / "src"
    shutil.copytree(SOURCE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [copy, *copy.rglob("*/")]:
        folder.chmod(0o555)
    lines = (
        f"import sys; sys.path.insert(0, {str(copy)!r})",
        "from cuboid.ground.compiling.kernelcache import cache_folder",  # `doctor` prints it
        "print(cache_folder())",
    )
    words = bound([sys.executable, "-B", "-c", "; ".join(lines)])
    home = tmp_path / "home"
    home.mkdir()
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("XDG", "NUMBA"))}
    try:
        said = run(words, env={**environment, "HOME": str(home)})
        assert said.returncode == 0, said.stdout + said.stderr
        assert said.stderr == ""
        assert f"{home}/.cache/cuboid/kernels" in said.stdout
        nowhere = run(words, env={**environment, "HOME": "/proc/nowhere", "TMPDIR": str(tmp_path / "home")})
        assert nowhere.returncode == 0, nowhere.stdout + nowhere.stderr
        assert f"{home}/cuboid-kernels-" in nowhere.stdout
    finally:
        for folder in [copy, *copy.rglob("*/")]:
            folder.chmod(0o755)
