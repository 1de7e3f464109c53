"""The commands as another user, and on a disk that is really full; by root alone, who can become one and mount one."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

import pytest
from commands import command, contents, refused, run, run_here

from fakes import write_recording

NOBODY = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", "--inh-caps=-all")
DISK_KB = 2048


@pytest.fixture
def place() -> Iterator[Path]:
    """Return a folder that all may enter: those of pytest are their user's alone."""
    folder = Path(tempfile.mkdtemp(prefix="cuboid-test-"))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


@pytest.fixture
def theirs(place: Path) -> Path:
    """Return a folder of another user's."""
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        pytest.skip("only root can become another user, by setpriv")
    if trial := trial_of_another_user():
        pytest.skip(f"another user cannot run this Python: {trial}")
    folder = place / "theirs"
    folder.mkdir()
    os.chown(folder, 65534, 65534)
    return folder


@cache
def trial_of_another_user() -> str:
    """Return why another user cannot run this Python; empty if one can."""
    trial = run(as_nobody(command("--version")))
    return trial.stderr.strip()[-100:] if trial.returncode else ""


def as_nobody(words: Sequence[str]) -> list[str]:
    return [*NOBODY, *words]


def surroundings(home: Path) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("XDG", "NUMBA"))}
    return {**kept, "HOME": str(home), "TMPDIR": str(home)}


def test_another_user_tracks_what_root_recorded(place: Path, theirs: Path) -> None:
    recording, own = write_recording(place / "recording", 12), surroundings(theirs)
    before = contents(recording)
    done = run(as_nobody(command("track", recording, "--output", theirs / "out")), env=own)
    assert done.returncode == 0, done.stderr
    assert (theirs / "out" / "tracks.csv").stat().st_uid == 65534
    again = run(as_nobody(command("track", recording, "--output", theirs / "out", "--force", "--video")), env=own)
    assert again.returncode == 0, again.stderr
    assert contents(recording) == before


def test_a_home_that_cannot_be_searched_is_passed_over(place: Path, theirs: Path) -> None:
    home = place / "closed"
    home.mkdir(mode=0o700)
    own = {**surroundings(home), "TMPDIR": str(theirs)}
    done = run(as_nobody(command("doctor")), env=own)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{theirs}/cuboid-kernels-65534" in done.stdout
    listed = run(as_nobody(command("scene", "list", theirs / "none.cuboid")), env=own)
    assert (listed.returncode, listed.stderr.count("\n")) == (2, 1)
    assert "there is no such scene file" in listed.stderr


def test_another_user_spoils_nothing_of_roots(place: Path, theirs: Path) -> None:
    recording, own = write_recording(place / "recording", 12), surroundings(theirs)
    out = place / "out"
    assert run_here("track", recording, "--output", out).returncode == 0
    before = contents(out), contents(recording)
    for words in (
        ("track", recording, "--output", out, "--force"),
        ("track", recording, "--output", place / "new"),
        ("report", out, "--force"),
        ("export", out, "--to", "json", "--output", place / "out.json"),
    ):
        said = run(as_nobody(command(*words)), env=own)
        said.stderr = "".join(line for line in said.stderr.splitlines(True) if "compiled kernels go to" not in line)
        assert "Permission denied" in refused(said), words
    written = run(as_nobody(command("export", out, "--to", "json", "--output", theirs / "out.json")), env=own)
    assert written.returncode == 0, written.stderr
    (recording / "camera.json").chmod(0o600)
    line = refused(run(as_nobody(command("track", recording, "--output", theirs / "out")), env=own))
    assert "camera.json: cannot be read: Permission denied" in line
    (recording / "camera.json").chmod(0o644)
    assert (contents(out), contents(recording)) == before
    assert {path.name for path in place.iterdir()} == {"out", "recording", "theirs"}


@pytest.fixture
def disk(place: Path) -> Iterator[Path]:
    """Return a disk of two megabytes."""
    folder = place / "disk"
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", f"size={DISK_KB}k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or shutil.which("mount") is None or subprocess.run(words, capture_output=True).returncode:
        pytest.skip("no disk can be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def fill(disk: Path, left_bytes: int) -> None:
    """Fill a disk up to so many bytes."""
    with open(disk / "filler", "wb", buffering=0) as file:
        with suppress(OSError):
            while True:
                file.write(b"x" * 4096)
        file.truncate(max(0, file.tell() - left_bytes))


@pytest.mark.parametrize("left_bytes", [0, 8192])
def test_a_really_full_disk_leaves_what_was_there(place: Path, disk: Path, left_bytes: int) -> None:
    recording, out = write_recording(place / "recording", 12), disk / "out"
    assert run_here("track", recording, "--output", out).returncode == 0
    (disk / "out.json").write_text("old")
    fill(disk, left_bytes)
    before = contents(disk)
    large = [
        ("track", recording, "--output", out, "--force"),
        ("track", recording, "--output", out, "--force", "--video"),
        ("track", recording, "--output", disk / "new"),
        ("report", out, "--force"),
        ("convert", recording, "--to", "plain", "--output", disk / "copy"),
    ]
    small = [("render", out, "--force"), ("export", out, "--to", "json", "--output", disk / "out.json", "--force")]
    for words in large if left_bytes else [large[0], *small]:
        # a video that could not be written stays open until the process ends, and the disk in use
        line = refused(run(command(*words)) if words[0] == "render" else run_here(*words))
        assert "cannot be written: the disk is full (No space left on device)" in line, words
        assert contents(disk) == before, words
    (disk / "filler").unlink()
    assert run_here("track", recording, "--output", out, "--force").returncode == 0


def test_a_full_disk_for_temporary_files_is_one_line_or_not_needed(place: Path, disk: Path) -> None:
    recording = write_recording(place / "recording", 12)
    fill(disk, 0)
    done = run(command("track", recording, "--output", place / "out"), env={**os.environ, "TMPDIR": str(disk)})
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
