"""Whether the top of an object was seen to end freely."""

from __future__ import annotations

import numpy as np

from cuboid.method.objects.outline import ends_above
from cuboid.method.surfaces.kernels.outlines import BORDER, FREE, HIDDEN, KINDS, TOP, UNSURE


def test_a_top_that_always_ends_at_another_object_does_not_end_freely() -> None:
    brim = np.zeros((4, KINDS))
    brim[TOP, UNSURE] = 20
    assert not ends_above(brim)
    brim[TOP, FREE] = 11
    assert ends_above(brim), "a third of its top was seen to end in free space"


def test_the_part_of_a_top_that_the_image_border_cuts_off_does_not_count() -> None:
    box = np.zeros((4, KINDS))
    box[TOP, FREE], box[TOP, HIDDEN], box[TOP, BORDER] = 4, 6, 200
    assert ends_above(box)
