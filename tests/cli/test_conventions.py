"""What holds for every command alike."""

from __future__ import annotations

import argparse
import json
import re
import shlex
import subprocess
import sys
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import pytest

from cuboid.cli import COMMANDS, main
from cuboid.cli.names import without_guessing
from cuboid.ground.core.config import TrackerConfig
from cuboid.inputs.readers import READERS
from cuboid.method.proposals import SOURCES
from cuboid.results.exports import EXPORTS
from fakes import FakeTracker, write_recording

MODULES = {name: import_module(f"cuboid.cli.{name.replace(' ', '_')}") for name in COMMANDS}


def parser_of(name: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"cuboid {name}", exit_on_error=False)
    MODULES[name].add_arguments(parser)
    return parser


def takes_nothing(name: str) -> bool:
    return not any(action.required for action in parser_of(name)._actions)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_example_is_one_of_the_command(name: str) -> None:
    example = MODULES[name].EXAMPLE.removeprefix('eval "$(').removesuffix(')"')
    words = shlex.split(example)
    assert words[: 1 + len(name.split())] == ["cuboid", *name.split()]
    parser_of(name).parse_args(words[1 + len(name.split()) :])  # raises where it is none


@pytest.mark.parametrize("name", [name for name in COMMANDS if not takes_nothing(name)])
def test_a_command_alone_says_what_it_needs_and_shows_an_example(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(name.split())
    out, err = capfd.readouterr()
    assert (ended.value.code, out, err.count("\n")) == (2, "", 1)
    assert "required: " in err
    assert f"for example: {MODULES[name].EXAMPLE}" in err


def test_an_option_of_several_commands_means_the_same() -> None:
    kinds: dict[str, set[tuple[object, ...]]] = {}
    for name in COMMANDS:
        for action in parser_of(name)._actions:
            for option in action.option_strings:
                kinds.setdefault(option, set()).add((action.nargs, tuple(map(str, action.choices or ()))))
    various = {option for option, found in kinds.items() if len(found) > 1}
    # forms of recordings, and forms of results; the file of a rig, its cameras, and the recordings of its cameras
    assert various <= {"--to", "--rig"}


@pytest.mark.parametrize("words", [("info", "R"), ("doctor",)])
def test_json_prints_and_json_with_a_file_writes(
    words: tuple[str, ...], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    recording = str(write_recording(tmp_path / "recording", 3))
    call = [recording if word == "R" else word for word in words]
    assert main([*call, "--json"]) == 0
    printed = json.loads(capfd.readouterr().out)
    assert main([call[0], "--json", *call[1:]]) == 0  # a recording behind it is no file to write
    assert json.loads(capfd.readouterr().out) == printed
    assert main([*call, "--json", str(tmp_path / "all.json")]) == 0
    assert not capfd.readouterr().out.startswith("{")
    assert json.loads((tmp_path / "all.json").read_text()) == printed


# Serve until Ctrl-C, or print a script: these have no results.
WITHOUT_RESULTS = {"annotate", "view", "mcp", "serve", "completion"}


def parsers_of(name: str) -> list[argparse.ArgumentParser]:
    """Return the parser of a command, or those of its verbs."""
    parser = parser_of(name)
    verbs = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return list(verbs[0].choices.values()) if verbs else [parser]


def test_all_commands_with_results_have_json_and_force_which_mean_the_same() -> None:
    meanings: dict[str, set[str | None]] = {"--json": set(), "--force": set()}
    for name in COMMANDS:
        for parser in parsers_of(name):
            for option, found in meanings.items():
                action = parser._option_string_actions.get(option)
                assert (action is None) == (name in WITHOUT_RESULTS), (parser.prog, option)
                if action is not None:
                    found.add(action.help)
    assert all(len(found) == 1 for found in meanings.values()), meanings


def test_o_is_output_for_all_commands() -> None:
    for name in COMMANDS:
        for parser in parsers_of(name):
            options = parser._option_string_actions
            assert options.get("-o") is options.get("--output"), parser.prog


@pytest.mark.parametrize("option", ["--json", "--force"])
def test_a_file_that_exists_is_replaced_with_force_only(
    option: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "all.json"
    file.write_text("mine")
    words = ["doctor", "--json", str(file)]
    if option == "--json":
        assert main(words) == 2
        assert capfd.readouterr().err == f"cuboid: error: {file}: exists; --force replaces it\n"
        assert file.read_text() == "mine"
    else:
        assert main([*words, "--force"]) == 0
        assert json.loads(file.read_text())["checks"]


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Results of a short run with a quick tracker."""
    monkeypatch.setattr("cuboid.runs.pipeline.run._tracker", FakeTracker)
    recording = write_recording(tmp_path / "recording", 3, (120, 160))
    assert main(["track", str(recording), "-o", str(tmp_path / "results"), "--video"]) == 0
    return tmp_path / "results"


@pytest.mark.parametrize(
    ("words", "keys"),
    [
        (("track", "RECORDING", "-o", "NEW"), {"output", "objects", "run"}),
        (("convert", "RECORDING", "-o", "NEW"), {"output", "form", "frames", "left_out"}),
        (("info", "RECORDING"), {"path", "format", "frames"}),
        (("bench", "RECORDING"), {"milliseconds", "frames_per_second"}),
        (("render", "RESULTS", "--force"), {"output", "frames"}),
        (("report", "RESULTS", "-o", "NEW.html"), {"output", "objects"}),
        (("export", "RESULTS", "--to", "csv", "-o", "NEW.csv"), {"output", "form", "notes"}),
        (("synth", "-o", "NEW", "--frames", "2", "--size", "64x48"), {"output", "name", "frames", "objects"}),
    ],
)
def test_json_is_all_that_is_printed(
    words: tuple[str, ...], keys: set[str], results: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    names = {"RECORDING": "recording", "RESULTS": "results", "NEW": "new", "NEW.html": "n.html", "NEW.csv": "n.csv"}
    call = [str(results.parent / names[word]) if word in names else word for word in words]
    capfd.readouterr()
    assert main([*call, "--json"]) == 0
    printed = json.loads(capfd.readouterr().out)
    assert keys <= printed.keys()


def test_render_and_report_ask_before_they_replace(results: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for command, name in (("render", "labelled.mp4"), ("report", "report.html")):
        before = (results / name).read_bytes()
        capfd.readouterr()
        assert main([command, str(results)]) == 2
        assert capfd.readouterr().err == f"cuboid: error: {results / name}: exists; --force replaces it\n"
        assert (results / name).read_bytes() == before
        assert main([command, str(results), "--force"]) == 0


def test_the_help_lists_the_names_that_options_take(capfd: pytest.CaptureFixture[str]) -> None:
    listed = {
        ("track",): [*READERS.names(), *SOURCES.names(), *(item.name for item in fields(TrackerConfig))],
        ("export",): EXPORTS.names(),
        ("scene", "export"): ["results", *EXPORTS.names()],
        ("convert",): ["plain", "tum", "mcap"],
        ("scene",): ["list", "show", "changes", "name", "merge", "forget", "check", "export", "compact"],
    }
    for words, names in listed.items():
        with pytest.raises(SystemExit) as ended:
            main([*words, "--help"])
        assert ended.value.code == 0
        shown = re.sub(r"-\s+", "-", capfd.readouterr().out)  # names are broken at hyphens
        assert [name for name in names if name not in shown] == []


def test_json_takes_no_word_that_is_no_json_file() -> None:
    assert without_guessing(["info", "--json", "rec"]) == ["info", "--json=-", "rec"]
    assert without_guessing(["info", "rec", "--json", "a.json"]) == ["info", "rec", "--json", "a.json"]
    assert without_guessing(["track", "--rerun", "rec"]) == ["track", "--rerun=viewer", "rec"]
    assert without_guessing(["track", "--rerun", "a.rrd"]) == ["track", "--rerun", "a.rrd"]
    assert without_guessing(["info", "rec", "--json"]) == ["info", "rec", "--json=-"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shell_is_told_how_to_complete(shell: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    out = capfd.readouterr().out
    assert "cuboid" in out
    assert "ARGCOMPLETE" in out.upper()


COMPLETED = {
    "cuboid exp": "export",
    "cuboid track r --dep": "--depth-scale",
    "cuboid synth --kind ro": "room",
    "cuboid track r --proposals edge": "edgeboxes",
    "cuboid track r --format stray": "stray-scanner",
    "cuboid track r --set vox": "voxel_m=",
    "cuboid track --camera real": "realsense",
    "cuboid export d --to coc": "coco",
    "cuboid convert r --to mca": "mcap",
    "cuboid scene comp": "compact",
    "cuboid scene export s --to resu": "results",
}
# Completion ends its process; here it goes on with the next line.
COMPLETE = """
import contextlib, os, sys
def ends(status): raise SystemExit(status)
os._exit = ends
from cuboid.cli import main
for k, line in enumerate(sys.argv[2:]):
    os.environ.update(_ARGCOMPLETE="1", COMP_LINE=line, COMP_POINT=str(len(line)), _ARGCOMPLETE_IFS="\\n")
    os.environ["_ARGCOMPLETE_STDOUT_FILENAME"] = os.path.join(sys.argv[1], str(k))
    with contextlib.suppress(SystemExit):
        main()
"""


def test_words_are_completed(tmp_path: Path) -> None:
    call = [sys.executable, "-c", COMPLETE, str(tmp_path), *COMPLETED]
    subprocess.run(call, check=True, timeout=60, stderr=subprocess.DEVNULL)
    answers = [(tmp_path / str(k)).read_text().split("\n") for k in range(len(COMPLETED))]
    assert [[word.strip() for word in words] for words in answers] == [[there] for there in COMPLETED.values()]
