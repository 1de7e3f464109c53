from __future__ import annotations

import pytest

import cuboid


@pytest.mark.parametrize("name", cuboid.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(cuboid, name) is not None
    assert name in dir(cuboid)


def test_another_name_is_not() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = cuboid.nothing
