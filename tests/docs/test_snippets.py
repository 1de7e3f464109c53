"""Every block of code that a page shows is run as it stands, page by page; what cannot run here is parsed."""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import pytest
from blocks import BLOCKS, REPOSITORY, SHELL, Block, commands_of, is_synopsis
from given import FRAMES, RECORDINGS, SIZE, Given

from cuboid.cli import COMMANDS, main
from cuboid.cli.names import without_guessing
from cuboid.results.views.serving import PageServer

LANGUAGES = {SHELL, "python", "json", "toml", "text"}
# What is added to a command: it is short here, and takes no port that another program may have.
ADDED = {
    "synth": ("--frames", FRAMES, "--size", SIZE, "--workers", "1"),
    "demo": ("--frames", "6"),
    "batch": ("--workers", "1"),
    "serve": ("--port", "0"),
}


class Parser(argparse.ArgumentParser):
    """Fails where it would end the program."""

    def error(self, message: str) -> NoReturn:
        raise AssertionError(message)


def command_and_rest(words: list[str]) -> tuple[str, list[str]]:
    """Split the words of ``cuboid ...`` into the command, which may have two words, and what follows."""
    two = " ".join(words[1:3])
    return (two, words[3:]) if two in COMMANDS else (words[1], words[2:])


def parser_of(command: str) -> Parser:
    """Return the parser of a command of the program."""
    parser = Parser(allow_abbrev=False)
    import_module(f"cuboid.cli.{command.replace(' ', '_')}").add_arguments(parser)
    return parser


def check_words(line: str) -> None:
    """Hold a command line of the program against its parser; of a synopsis, the names of command and options."""
    words = shlex.split(line)
    command, rest = command_and_rest(words)
    assert command in COMMANDS, f"no command '{command}'"
    parser = parser_of(command)
    if not is_synopsis(line):
        parser.parse_args(without_guessing(rest))
        return
    known = parser.format_help()
    for option in re.findall(r"(?<![\w-])--[a-z][\w-]*", line):
        assert re.search(rf"(?<![\w-]){option}(?![\w-])", known), f"'{command}' has no option {option}"


def check_only(block: Block) -> None:
    """Check a block of commands that is not run: what of it is ours exists."""
    for line in commands_of(block):
        for part in re.split(r"\s*&&\s*", line):
            if ours := re.search(r"(?:^|\bbin/|^ssh .* )cuboid (.*)", part):
                check_words(f"cuboid {ours[1]}")
            for file in re.findall(r"(?:^|\s)((?:docs|benchmarks|tests|requirements)/\S+|pyproject\.toml)", part):
                assert (REPOSITORY / file).exists(), f"{block}: {file} is not there"


def again(words: list[str], done: set[tuple[str, ...]]) -> tuple[str, ...]:
    """Return what is added to a call that differs from an earlier one of its page by the recording's name alone.

    All names stand for the same recording here, so that a short run shows that the words are right.
    """
    bare = tuple("RECORDING" if word in RECORDINGS else word for word in words)
    if words[1] != "track" or bare not in done:
        done.add(bare)
        return ()
    return ("--limit", "2")


def run_commands(block: Block, done: set[tuple[str, ...]]) -> None:
    """Run the commands of a block: those of the program in this process, others in a shell."""
    for line in commands_of(block):
        if is_synopsis(line):
            check_words(line.removeprefix(".venv/bin/python ")) if line.startswith("cuboid ") else check_only(block)
        elif line.startswith("cuboid "):
            words = shlex.split(line)
            clear_output(words)
            assert main([*words[1:], *ADDED.get(words[1], ()), *again(words, done)]) == 0, f"{block}: {line}"
        else:
            path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
            subprocess.run(["bash", "-euc", line], env={**os.environ, "PATH": path}, check=True, timeout=60)


def clear_output(words: list[str]) -> None:
    """Free a place in capitals that a command writes to: it stands for another place in each block of a page."""
    if "--output" in words and words[1] in ("track", "convert", "slam", "synth"):
        output = Path(words[words.index("--output") + 1])
        if output.name.isupper() or re.fullmatch(r"[A-Z]+\d", output.name):
            shutil.rmtree(output, ignore_errors=True)


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Given:
    return Given(tmp_path_factory.mktemp("given"))


@pytest.fixture
def nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages are served until Ctrl-C, which comes at once; no browser opens."""
    serve: Callable[..., None] = PageServer.serve_forever

    def interrupted(self: PageServer, *args: Any) -> None:
        if threading.current_thread() is threading.main_thread():
            raise KeyboardInterrupt
        serve(self, *args)

    def interrupted_app(self: object, sockets: list[Any]) -> None:
        for one in sockets:
            one.close()
        raise KeyboardInterrupt

    monkeypatch.setattr(PageServer, "serve_forever", interrupted)
    monkeypatch.setattr("webbrowser.open", lambda *args: True)
    monkeypatch.setattr("uvicorn.Server.run", interrupted_app)


def test_every_block_has_a_language() -> None:
    assert len(BLOCKS) > 100
    assert [str(block) for block in BLOCKS if block.language not in LANGUAGES] == []


@pytest.mark.usefixtures("nobody_looks")
@pytest.mark.parametrize("page", sorted({block.page for block in BLOCKS}))
def test_what_a_page_shows_runs(page: str, given: Given, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = [block for block in BLOCKS if block.page == page]
    monkeypatch.chdir(tmp_path)
    for name in given.always("\n".join(block.text for block in blocks if not block.not_run)):
        given.put(name, tmp_path)
    names: dict[str, object] = {"__name__": page}
    done: set[tuple[str, ...]] = set()
    for block in blocks:
        for name in block.given:
            given.put(name, tmp_path)
        if block.language == SHELL:
            check_only(block) if block.not_run else run_commands(block, done)
        elif block.language == "python":
            code = compile("\n" * (block.line - 1) + block.text, page, "exec")
            if not block.not_run:
                exec(code, names)
        elif block.language == "json":
            json.loads(block.text)
        elif block.language == "toml":
            tomllib.loads(block.text)


def test_the_types_of_all_python_blocks_hold(tmp_path: Path) -> None:
    texts: dict[str, list[str]] = {}
    for block in BLOCKS:
        if block.language == "python":
            lines = texts.setdefault(re.sub(r"\W", "_", block.page), [])
            lines += [""] * (block.line - 1 - len(lines)) + block.text.splitlines()  # lines as the page counts them
    for name, lines in texts.items():
        (tmp_path / f"{name}.py").write_text("\n".join(lines) + "\n")
    words = (sys.executable, "-m", "mypy", *(str(file) for file in tmp_path.glob("*.py")))
    environment = {**os.environ, "MYPYPATH": "src"}  # as the repository's own check has it, whose cache is used
    done = subprocess.run(words, cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_enough_is_run() -> None:
    lines = [line for block in BLOCKS if block.language == SHELL and not block.not_run for line in commands_of(block)]
    run = [line for line in lines if line.startswith("cuboid ") and not is_synopsis(line)]
    assert len(run) > 60
    # tests/ros2 runs the documented call of `ros2`, between a player and a listener; tests/cli that of `detect`.
    only_described = {"doctor", "completion", "report", "evaluate trajectory", "store compact", "ros2", "detect"}
    assert {command_and_rest(shlex.split(line))[0] for line in run} >= set(COMMANDS) - only_described
    assert sum(block.language == "python" and not block.not_run for block in BLOCKS) > 10
