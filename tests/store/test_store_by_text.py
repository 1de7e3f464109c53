"""Objects of a store ranked by a text, on the command line, in the pages and in the API."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

pytest.importorskip("tokenizers")

from made_stores import put_run, thing

from cuboid.cli import main
from cuboid.fleet.store.folder import StoreFolder
from cuboid.method.text_search import TextModel
from made_text_models import made_text_model
from served import served


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory, model: Path) -> str:
    """Of four things one has a vector of another model, and one has none."""
    place = StoreFolder(str(tmp_path_factory.mktemp("found")))
    opened = TextModel(model)

    def vector(text: str) -> dict:
        return {"embedding": opened.query(text).vector.tolist(), "embedding_model": opened.identity}

    other = {"embedding": [1.0, 0.0], "embedding_model": "another"}
    put_run(place, 1, [thing(1, **vector("red")), thing(2, **vector("blue"))], recording="kitchen")
    put_run(place, 2, [thing(3, **vector("green"), longest_m=0.4), thing(4, **other), thing(5)], recording="office")
    return place.url


@pytest.fixture(scope="module")
def address(store: str, model: Path) -> Iterator[str]:
    with served(store, "--text-model", str(model)) as where:
        yield where


def found(capsys: pytest.CaptureFixture[str], store: str, *words: str) -> list[int]:
    assert main(["find", store, *words, "--json"]) == 0
    return [row["label"] for row in json.loads(capsys.readouterr().out)["objects"]]


def test_the_best_come_first(capsys: pytest.CaptureFixture[str], store: str, model: Path) -> None:
    for text, best in (("red", 1), ("blue", 2), ("green", 3)):
        labels = found(capsys, store, "--text", text, "--text-model", str(model))
        assert labels[0] == best
        assert set(labels) == {1, 2, 3}
    words = ("--text", "green", "--text-model", str(model))
    assert found(capsys, store, *words, "--size", "..20cm")[0] != 3
    assert found(capsys, store, *words, "--limit", "1") == [3]
    assert set(found(capsys, store, *words, "--like", "kitchen#1")) == {2, 3}
    assert main(["find", store, *words]) == 0
    assert "text_score" in capsys.readouterr().out


def test_the_environment_names_the_model(
    capsys: pytest.CaptureFixture[str], store: str, model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CUBOID_TEXT_MODEL", str(model))
    assert found(capsys, store, "--text", "blue")[0] == 2


def test_what_cannot_be_answered_is_refused(
    refused: Callable[..., str], store: str, model: Path, tmp_path: Path
) -> None:
    other = made_text_model(tmp_path / "other", image_output="else")
    assert "no object has a vector of this model; 'cuboid batch --text-model' makes them" in refused(
        "find", store, "--text", "red", "--text-model", str(other)
    )
    wide = made_text_model(tmp_path / "wide", width=4)  # its images are those of the store
    assert "vectors have 3 numbers, that of the text 4" in refused(
        "find", store, "--text", "red", "--text-model", str(wide)
    )
    assert "--text-model needs --text" in refused("find", store, "--text-model", str(model))
    assert "got an empty text" in refused("find", store, "--text", " ", "--text-model", str(model))


def test_pages_and_api_rank_where_the_server_has_a_model(address: str, store: str) -> None:
    with urlopen(f"{address}/api/objects?text=blue", timeout=60) as answer:
        rows = json.loads(answer.read())["objects"]
    assert rows[0]["label"] == 2
    assert rows[0]["text_score"] == pytest.approx(1.0, abs=1e-5)
    with urlopen(f"{address}/?text=green&max_size=20cm", timeout=60) as answer:
        page = answer.read().decode()
    assert 'name="text"' in page
    cards = re.findall(r'<p class="whose">(.*?)</p>.*?title="(#\d+)', page)
    assert ("kitchen", "#1") in cards
    assert ("office", "#3") not in cards
    with urlopen(f"{address}/openapi.json", timeout=60) as answer:
        names = {one["name"] for one in json.loads(answer.read())["paths"]["/api/objects"]["get"]["parameters"]}
    assert "text" in names
    with served(store) as bare:
        with urlopen(f"{bare}/", timeout=60) as answer:
            assert 'name="text"' not in answer.read().decode()
        with pytest.raises(HTTPError) as error:
            urlopen(f"{bare}/api/objects?text=blue", timeout=60)
        with error.value as answer:
            assert "this server has no image-text model" in json.loads(answer.read())["error"]
