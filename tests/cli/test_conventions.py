"""What holds for every command alike."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from cuboid.cli import COMMANDS, main
from cuboid.cli.optional_words import without_guessing
from fakes import write_recording

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
    assert various <= {"--to"}  # forms of recordings, and forms of results


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


@pytest.mark.parametrize(
    ("line", "there"),
    [("cuboid exp", "export"), ("cuboid track r --dep", "--depth-scale"), ("cuboid synth --kind ro", "room")],
)
def test_words_are_completed(line: str, there: str, tmp_path: Path) -> None:
    script = "from cuboid.cli import main; main()"
    answers = tmp_path / "answers"
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": "\n"}
    asked["_ARGCOMPLETE_STDOUT_FILENAME"] = str(answers)
    environment = {**os.environ, **asked}
    subprocess.run([sys.executable, "-c", script], env=environment, check=False, timeout=30, stderr=subprocess.DEVNULL)
    assert [word.strip() for word in answers.read_text().split("\n")] == [there]
