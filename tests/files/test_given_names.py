"""A name that people give to an object of finished results wins over that of a detector, which comes back after it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from cuboid.results.files import open_results
from cuboid.results.files.naming import name_object
from cuboid.results.files.objects import read_objects, write_objects
from made_results import write_results


def test_a_given_name_wins_and_can_be_taken_away(tmp_path: Path) -> None:
    folder = write_results(tmp_path)
    found = read_objects(folder / "objects.json")
    cup = dataclasses.replace(found.objects[0], name="cup", name_score=0.9, names=(("bowl", 0.05),))
    write_objects(folder / "objects.json", dataclasses.replace(found, objects=(cup, *found.objects[1:])))
    name_object(folder, cup.label, "Anna's")
    named = open_results(folder).found.objects[0]
    assert (named.name, named.name_score, named.names) == ("Anna's", None, (("cup", 0.9), ("bowl", 0.05)))
    name_object(folder, cup.label, "Ben's")
    assert open_results(folder).found.objects[0].names == named.names
    name_object(folder, cup.label, "")
    again = open_results(folder).found.objects[0]
    assert (again.name, again.name_score, again.names) == ("cup", 0.9, (("bowl", 0.05),))
    name_object(folder, cup.label, "")
    assert open_results(folder).found.objects[0].name == "cup"
