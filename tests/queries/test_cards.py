"""Cards as answers: the picture of the last sighting where there is one, and the page where the object still is."""

from __future__ import annotations

import pytest

from cuboid.services.queries.cards import Card, answering
from cuboid.services.queries.english import WHERE


def card(state: str = "present") -> Card:
    return Card("3", {"label": 3, "state": state}, "best.jpg", "report.html#3", links={"Similar": "?like=3"})


@pytest.mark.parametrize("last", ["last.jpg", None])
def test_the_last_picture_is_a_link_or_the_picture_itself(last: str | None) -> None:
    other, where = answering(card(), last, ()), answering(card(), last, (WHERE,))
    assert other.picture == "best.jpg"
    assert list(other.links) == (["Similar"] if last is None else ["Last picture", "Similar"])
    assert where.picture == (last or "best.jpg")
    assert list(where.links) == ["Similar"]


def test_the_page_of_the_map_has_no_gone_object() -> None:
    assert answering(card(), None, ()).page == "report.html#3"
    assert answering(card("gone"), None, ()).page is None
