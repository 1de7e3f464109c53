"""Questions in plain English as conditions."""

from __future__ import annotations

import re
from math import inf
from typing import Any

import pytest

from cuboid.ground.core.errors import InputError
from cuboid.services.queries.english import COUNT, WHERE, understand
from cuboid.services.queries.filters import Filters

NAMES = ("bin", "box", "cardboard box", "chair", "cup", "red cup", "glass")


@pytest.mark.parametrize(
    ("question", "conditions"),
    [
        ("bin", {"name": "bin"}),
        ("Find all bins!", {"name": "bin"}),
        ("the blue bin beside the chair", {"name": "bin", "color": "blue", "beside": "chair"}),
        ("is there a gray chair?", {"name": "chair", "color": "grey"}),
        ("the red cup", {"name": "red cup"}),  # a name of two words comes before a color and a name
        ("the red bin", {"name": "bin", "color": "red"}),
        ("glasses in the cardboard box", {"name": "glass", "inside": "cardboard box"}),
        ("what is on top of object 7", {"on": "7"}),
        ("cups standing on plane:1", {"name": "cup", "on": "plane:1"}),
        ("which things are on the floor", {"on": "floor"}),
        ("everything between 10 and 25 cm", {"size_m": (0.1, 0.25)}),
        ("small things next to the box", {"size_m": (0.0, 0.15), "beside": "box"}),
        ("a large box larger than 50cm", {"name": "box", "size_m": (0.5, inf)}),
        ("anything at most 80 mm long", {"size_m": (0.0, 0.08)}),
        ("things about 20 cm", {"size_m": (0.15, 0.25)}),
        ("cups within 30 cm of the chair", {"name": "cup", "near_object": "chair", "within_m": 0.3}),
        ("lamp near the chair", {"name": "lamp", "near_object": "chair"}),  # a name that nothing has is a question too
        ("bins in recording kitchen-*", {"name": "bin", "recording": "kitchen-*"}),
        ("all objects", {}),
        ("what is to the left of the chair?", {"side": ("left of", "chair")}),
        ("the cup behind object 7", {"name": "cup", "side": ("behind", "7")}),
        ("the tallest bin", {"name": "bin", "order": "tallest"}),
        ("biggest thing on the floor", {"order": "largest", "on": "floor"}),
        ("the cup nearest to the chair", {"name": "cup", "order": "nearest", "near_object": "chair", "within_m": inf}),
    ],
)
def test_what_is_understood(question: str, conditions: dict[str, Any]) -> None:
    understood = understand(question, NAMES)
    assert understood.filters == Filters(**conditions)
    assert understood.last is None
    assert understood.said


@pytest.mark.parametrize(
    ("question", "last"),
    [
        ("Where is the bin?", "bin"),
        ("when was the red cup last seen", "red cup"),
        ("where did you last see the chair", "chair"),
        ("where is object 7", "7"),
    ],
)
def test_where_and_when(question: str, last: str) -> None:
    understood = understand(question, NAMES)
    assert understood.last == last
    assert understood.said[-1] == WHERE


@pytest.mark.parametrize(
    ("question", "said"),
    [
        ("", "the question is empty"),
        ("the shiny bin", "not understood from 'shiny bin' on. A question has colors"),
        (
            "the blue bin under the chair",
            "not understood from 'under the chair' on; understood: color blue, named 'bin'",
        ),
        ("the bin beside the", "beside what? Expected a name, a label, or floor"),
        ("blue and white bins", "two conditions of one kind: color white"),
        ("things larger than 10", "10 what? A length needs its unit: 10cm, or 10m"),
        ("the bin since yesterday", "expected 2026-03-01"),
        ("bin; drop table objects", "not understood from 'bin;"),
    ],
)
def test_what_is_not_understood_is_said_in_one_line(question: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as error:
        understand(question, NAMES)
    assert "\n" not in str(error.value)


def test_how_many_asks_for_their_number() -> None:
    assert understand("how many bins are there?", NAMES).said == ("named 'bin'", COUNT)
    assert COUNT not in understand("the bins", NAMES).said
