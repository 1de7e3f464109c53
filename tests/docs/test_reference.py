"""The reference pages, which are made from the program when the site is built."""

from __future__ import annotations

import argparse
import importlib.util
import re
import sys
from collections.abc import Iterator
from dataclasses import fields
from types import ModuleType

import pytest
from blocks import REPOSITORY

from cuboid.cli import COMMANDS
from cuboid.fleet.store import schema
from cuboid.fleet.store.asgi import PATHS
from cuboid.ground.core.config import TrackerConfig
from cuboid.results.exports import EXPORTS
from cuboid.runs.scene import schema as scene_schema
from cuboid.services.service.endpoints import ENDPOINTS


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    """The script that makes the pages."""
    spec = importlib.util.spec_from_file_location("make_reference", REPOSITORY / "docs" / "make_reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(REPOSITORY / "docs")  # as MkDocs does
        spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def pages(reference: ModuleType) -> dict[str, str]:
    return {name.removeprefix("reference/"): text for name, text in reference.files().items()}


def first_cells(text: str) -> list[str]:
    """Return the names in the first column of the tables in a text."""
    return re.findall(r"^\| `([^`]+)` \|", text, re.MULTILINE)


def options_of(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the options of a command, and of its verbs."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for verb in action.choices.values():
                yield from options_of(verb)
        elif action.option_strings and "--help" not in action.option_strings:
            yield action


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_of_a_command_stands_there_with_its_purpose(
    command: str, reference: ModuleType, pages: dict[str, str]
) -> None:
    section = pages["commands.md"].split(f"### `cuboid {command}`\n")[1].split("\n### ")[0]
    rows = dict(re.findall(r"^\| `([^`]+)` \| (.*) \|$", section, re.MULTILINE))
    assert reference.parser_of(command).example in section
    for action in options_of(reference.parser_of(command)):
        words = ", ".join(action.option_strings)
        purposes = [text for cell, text in rows.items() if cell == words or cell.startswith(f"{words} ")]
        assert purposes, words
        assert all(len(text) > 5 and "%(" not in text for text in purposes), words


def test_every_setting_stands_there(pages: dict[str, str]) -> None:
    assert first_cells(pages["settings.md"]) == [one.name for one in fields(TrackerConfig)]


def test_every_file_stands_there_with_its_schema(reference: ModuleType, pages: dict[str, str]) -> None:
    formats = sys.modules[reference.markdown.__module__]
    for name, kind in formats.DOCUMENTS.items():
        section = pages["files.md"].split(f"\n## `{name}`\n")[1].split("\n## ")[0]
        encoded = set(kind.__struct_encode_fields__)
        assert encoded <= {*first_cells(section)}, name
        assert '"$schema"' in pages[f"schemas/{name.replace('.json', '.schema.json')}"]
    for name, row in formats.TABLES.items():
        assert {*row.__struct_fields__} <= {*first_cells(pages["files.md"].split(name)[-1])}, name


def test_every_export_address_and_column_stands_there(pages: dict[str, str]) -> None:
    assert first_cells(pages["exports.md"])[1:] == sorted(EXPORTS.names())
    assert {one.path for one in ENDPOINTS} | {*PATHS} <= {*first_cells(pages["http.md"])}
    for table in schema.TABLES.values():
        section = pages["store.md"].split(f"\n## `{table.name}`\n")[1].split("\n## ")[0]
        assert first_cells(section) == [one.name for one in table.columns] + ["day"]


def test_every_table_of_a_scene_stands_there_with_the_state(pages: dict[str, str]) -> None:
    tables, _, state = pages["scene.md"].partition("## The state\n")
    named = dict(re.findall(r"^\| `(\w+)` \| [^|]+ \| (.+) \|$", tables, re.MULTILINE))
    for name, table in scene_schema.TABLES.items():
        assert re.findall(r"`(\w+)`", named[name]) == list(table.columns), name
    assert "### `tracker/map/store/objects/N`" in state
    assert "`log_odds`" in state
