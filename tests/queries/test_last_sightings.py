"""What is known of an object after its last sighting, names, and colors, of results whose every figure is known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from called import called
from cuboid.cli import main
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.geometry.box import Box
from cuboid.results.files import open_results
from cuboid.services.queries.likeness import color_fractions, colors_of
from cuboid.services.queries.looking import frames_that_show
from cuboid.services.queries.opening import open_place
from cuboid.services.queries.words import length, sizes
from made_place import write_place

CAMERA = Intrinsics(100.0, 100.0, 50.0, 50.0, 100, 100)


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return write_place(tmp_path, begin_s=0.0)


def test_a_frame_shows_a_place_if_the_whole_box_is_in_the_picture_and_near_enough() -> None:
    box = Box(np.array([0.0, 0.0, 2.0]), np.full(3, 0.2), np.eye(3))
    poses = {k: np.eye(4) for k in range(6)}
    poses[1][0, 3] = 0.86  # 0.76 m to the left of the camera's axis at the near side, 1.9 m away: it sees 0.95 m
    poses[2][0, 3] = 0.9  # 1 m: out of the picture
    poses[3][2, 3] = -1.5  # 3.6 m away, beyond the limit
    poses[4][:3, :3] = np.diag([-1.0, 1.0, -1.0])  # looks away
    assert frames_that_show(box, poses, -1, CAMERA, 3.0) == [0, 5]
    del poses[1]
    assert frames_that_show(box, poses, 0, CAMERA, 3.0) == [5]


def let_go(results: Path) -> None:
    """Object 4 is no longer in `objects.json`; its rows and its event tell where and when it was."""
    document = json.loads((results / "objects.json").read_text())
    document["objects"] = [one for one in document["objects"] if one["label"] != 4]
    (results / "objects.json").write_text(json.dumps(document))
    header = "frame,timestamp,event,label,from_x,from_y,from_z,to_x,to_y,to_z,score"
    (results / "events.csv").write_text(f"{header}\n4,4.0,gone,4,2,0,0.1,,,,1\n")


def test_an_object_that_left_is_gone_since_the_event(results: Path) -> None:
    let_go(results)
    place = open_place(str(results))
    (parcel,) = place.last_seen("4")
    assert (parcel.state, parcel.last_seen.frame, parcel.frames_seen, parcel.color) == ("gone", 2, 3, None)
    assert parcel.later is not None
    assert parcel.later.at is not None
    assert (parcel.later.state, parcel.later.at.frame) == ("gone", 4)
    assert place.about().objects == 4
    assert main(["find", str(results), "--last", "4"]) == 0


def test_an_object_that_left_keeps_or_gets_a_name(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    let_go(results)
    assert main(["report", str(results)]) == 0
    assert main(["name", str(results), "4=parcel", "1=bin"]) == 0
    assert open_results(results).name(4, "parcel").name == "parcel"
    (parcel,) = open_place(str(results)).ask("where is the parcel").objects
    assert (parcel.label, parcel.name, parcel.state) == (4, "parcel", "gone")
    capsys.readouterr()
    assert main(["find", str(results)]) == 0
    assert "parcel" in capsys.readouterr().out
    page = json.loads((results / "report.html").read_text().split('id="data">')[1].split("</script>")[0])
    assert [(one["label"], one["name"]) for one in page["gone"]] == [(4, "parcel")]
    assert main(["name", str(results), "4=", "1=crate"]) == 0
    assert "gone" not in json.loads((results / "objects.json").read_text())


def test_a_place_without_dates_says_frames(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["find", str(results), "--last", "mug"]) == 0
    said = capsys.readouterr().out
    assert said == (
        "results#5 mug: still there at the end\n"
        "  last seen at (0.30, 0.00, 0.58) in frame 5 of recording\n"
        "  0.65 m from the camera, which was at (0.00, 0.00, 0.00)\n"
    )
    assert main(["find", str(results)]) == 0
    assert "frame 2" in capsys.readouterr().out


def test_names_by_the_command_in_python_and_in_the_page(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(results)]) == 0
    assert main(["name", str(results), "1=bin", "#3=red book"]) == 0
    open_results(results).name(4, "parcel")
    open_results(results).name(4, "")
    page = (results / "report.html").read_text(encoding="utf-8")
    assert '"name":"bin"' in page
    assert '"name":"red book"' in page
    assert [one.name for one in open_results(results).objects] == ["bin", "can", "red book", None, "mug"]
    capsys.readouterr()
    for words, said in (
        (["99=bin"], "no object has the label 99"),
        (["bin"], "expected LABEL=NAME such as 1=bin, got 'bin'"),
        (["kitchen#1=bin"], "only objects of a store are named with their recording"),
        (["1=two\nlines"], "a name is one line"),
    ):
        done = called("name", results, *words)
        assert (done.returncode, said in done.stderr) == (2, True)


def test_where_nothing_has_a_name_the_answer_says_how_to_give_one(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads((results / "objects.json").read_text())
    for one in document["objects"]:
        for field in ("name", "name_score", "names"):
            one.pop(field, None)
    (results / "objects.json").write_text(json.dumps(document))
    assert main(["find", str(results), "--name", "bin"]) == 0
    assert "no object has a name yet; 'cuboid name DIR 1=bin' gives object 1 a name" in capsys.readouterr().out
    with pytest.raises(InputError, match="no object has a name yet"):
        open_place(str(results)).last_seen("bin")


@pytest.mark.parametrize(
    ("rgb", "word"),
    [
        ((29, 31, 54), "blue"),
        ((50, 25, 25), "red"),
        ((20, 20, 24), "black"),
        ((45, 45, 45), "black"),
        ((128, 124, 120), "grey"),
        ((235, 230, 220), "white"),
        ((110, 70, 40), "brown"),
    ],
)
def test_a_dark_color_has_its_hue(rgb: tuple[int, int, int], word: str) -> None:
    assert colors_of(color_fractions(np.array([rgb], np.uint8))) == (word,)


def test_an_object_of_two_colors_has_both() -> None:
    rgb = np.array([(20, 40, 160)] * 6 + [(240, 240, 240)] * 4, np.uint8)
    assert colors_of(color_fractions(rgb)) == ("blue", "white")
    assert colors_of(color_fractions(rgb[:8])) == ("blue",)
    assert colors_of(color_fractions(rgb[:0])) == ()


def test_lengths_need_units() -> None:
    assert (length("14cm"), length("0"), sizes("8..14cm"), sizes("0..50mm")) == (0.14, 0.0, (0.08, 0.14), (0.0, 0.05))
    for read, text in ((length, "14"), (sizes, "8..14"), (sizes, "..0.5"), (sizes, "8cm..14")):
        with pytest.raises(ValueError, match=r"what\? A length needs its unit"):
            read(text)
