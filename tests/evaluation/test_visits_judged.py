"""The truth of several visits is validated."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cuboid.ground.core.errors import InputError
from cuboid.ground.formats.json_validation import read_json
from cuboid.ground.formats.visits_file import VisitsDocument
from cuboid.lab.evaluation.visits import evaluate_visits
from cuboid.lab.synthetic import make_visits, render_visits

CHANGE = {"id": 1, "change": "moved", "judged": True, "metres": 0.3, "empty_frames": 4, "seen_frames": 9}


def document(*visits: Any, **more: Any) -> dict[str, Any]:
    return {"format": "cuboid-visits", "version": 1, "visits": list(visits), **more}


@pytest.mark.parametrize(
    ("said", "says"),
    [
        ([], "expected an object"),
        (document(version=2), "expected format 'cuboid-visits' version 1, got 'cuboid-visits' version 2"),
        (document({"recording": "../../etc", "changes": []}), r"visits\[0\]\.recording"),
        (document({"recording": "..", "changes": []}), "expected the name of a folder"),
        (document({"recording": "a", "changes": [{**CHANGE, "change": "lost"}]}), r"changes\[0\]\.change"),
        (document({"recording": "a", "changes": [{**CHANGE, "seen_frames": 1e300}]}), r"seen_frames: expected a whole"),
        (document({"recording": "a", "changes": [CHANGE, CHANGE]}), "id 1 is there twice"),
    ],
)
def test_what_is_wrong_with_visits_is_one_line(tmp_path: Path, said: Any, says: str) -> None:
    (tmp_path / "visits.json").write_text(json.dumps(said))
    with pytest.raises(InputError, match=says):
        evaluate_visits(tmp_path / "none.cuboid", tmp_path)


def test_made_visits_are_read_as_they_were_written(tmp_path: Path) -> None:
    made = make_visits("table", 2, 2, frames=4)
    told = render_visits(made, tmp_path / "v", size=(80, 60), sensor="clean")
    read = read_json(tmp_path / "v" / "visits.json", VisitsDocument)
    assert [one.recording for one in read.visits] == [one["recording"] for one in told["visits"]]
    assert [one.begun_at for one in read.visits[1].changes] == [
        None if one["from"] is None else tuple(one["from"]) for one in told["visits"][1]["changes"]
    ]
