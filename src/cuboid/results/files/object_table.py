"""The objects of a map as a list that is also a table: in a notebook, and for pandas."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from cuboid.ground.core.errors import InputError, shown
from cuboid.ground.core.extras import require
from cuboid.ground.core.records import box_numbers, names_in, table_columns_of
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.core.sizes import size_text, unseen_text

# Width of the plan in a notebook, pixels; free margin around the objects, fraction of the width.
PLAN_PX, PLAN_MARGIN = 320, 0.08
# Length and width along the axes of the box, and height along the normal of its support.
SIZE_HEADING = "length x width x height (cm)"
# With half the 95 % interval of each.
SURE_SIZE_HEADING = "length x width x height (cm), ± 95 %"
HEADINGS = ("label", SURE_SIZE_HEADING, "centre x, y, z (m)", "frames seen", "probability")


class ObjectTable(list[TrackedObject]):
    """A list of objects that is also a table: the `objects` of results, of a tracker and of a scene."""

    def __repr__(self) -> str:
        return f"ObjectTable({len(self)} objects)" + "".join(f"\n  {item}" for item in self)

    def find(self, label: int) -> TrackedObject:
        """Return the object with a label, or the one that the label was merged into.

        Raises
        ------
        InputError
            No object in the list has the label.
        """
        for item in self:
            if item.label == label or label in item.merged_labels:
                return item
        labels = ", ".join(str(item.label) for item in self) or "none"
        raise InputError(f"no object has the label {shown(label)}; expected one of {labels}")

    def rows(self) -> list[dict[str, Any]]:
        """Return a row of plain values for each object: lengths in metres, in the world, quaternion with w first."""
        return [_row(item) for item in self]

    def to_pandas(self) -> Any:
        """Return the rows as a pandas.DataFrame with the labels as its index.

        The column `plane` is of the type Int64, `<NA>` if an object stands on no known plane; `name` is None if
        an object has none.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        pandas = require("pandas", "to_pandas", pip="pandas")
        return pandas.DataFrame(self.rows(), columns=COLUMNS).set_index("label").astype({"plane": "Int64"})

    def _repr_html_(self) -> str:
        """Show a plan from above and a table in a notebook."""
        head = "".join(f"<th>{escape(text)}</th>" for text in HEADINGS)
        body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in _cells(item))}</tr>" for item in self)
        return f"{self._plan()}<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    def _plan(self) -> str:
        """Return an SVG of the footprints of the boxes, seen along the world axis closest to their mean up axis."""
        if not self:
            return "<p>no object</p>"
        axis = int(np.argmax(np.abs(sum(item.box.rotation[:, 2] for item in self))))
        sides = [k for k in range(3) if k != axis]
        feet = [item.box.corners()[[0, 1, 3, 2]][:, sides] for item in self]
        low = np.min([foot.min(axis=0) for foot in feet], axis=0)
        high = np.max([foot.max(axis=0) for foot in feet], axis=0)
        scale = PLAN_PX * (1 - 2 * PLAN_MARGIN) / max(float((high - low).max()), 1e-6)
        height = (high[1] - low[1]) * scale + 2 * PLAN_MARGIN * PLAN_PX
        placed = [(foot - low) * scale + PLAN_MARGIN * PLAN_PX for foot in feet]
        shapes = "".join(_shape(item, foot, height) for item, foot in zip(self, placed, strict=True))
        return f'<svg width="{PLAN_PX}" height="{height:.0f}" style="background:#fafafa">{shapes}</svg>'


def _shape(item: TrackedObject, foot: Any, height: float) -> str:
    from cuboid.ground.core.palette import hex_of

    foot[:, 1] = height - foot[:, 1]  # y goes up
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in foot)
    x, y = foot.mean(axis=0)
    color = hex_of(item.label)
    return (
        f'<polygon points="{points}" fill="{color}" fill-opacity="0.35" stroke="{color}"/>'
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="12" text-anchor="middle">{_title(item)}</text>'
    )


def _title(item: TrackedObject) -> str:
    return escape(f"{item.label} {item.name or ''}".rstrip())


def _cells(item: TrackedObject) -> tuple[str, ...]:
    from cuboid.ground.core.palette import hex_of

    return f'<span style="color:{hex_of(item.label)}">&#9632;</span> {_title(item)}', *cells_of(item)


def cells_of(item: TrackedObject, *, errors: bool = True) -> tuple[str, ...]:
    """Return size (cm), position (m), number of frames and probability of an object for printed tables."""
    return size_cell(item, errors=errors), item.box.center_text, str(item.frames_seen), f"{item.probability:.2f}"


def size_cell(item: TrackedObject, *, errors: bool = True) -> str:
    """Return the size of an object (cm) for printed tables, and whether a side was not seen."""
    size = size_text(item.box.size, item.size_sigma_m, errors=errors)
    return ", ".join(filter(None, (size, unseen_text(item.sides_seen, item.size_sigma_m))))


_NAMED = tuple(column for column in table_columns_of(TrackedObject) if column.name in ("label", "name"))
_OTHERS = tuple(column for column in table_columns_of(TrackedObject) if column not in _NAMED)
_BOX = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "qw", "qx", "qy", "qz")
COLUMNS = (*names_in(_NAMED), *_BOX, *names_in(_OTHERS))


def _row(item: TrackedObject) -> dict[str, Any]:
    named, others = ([value for column in columns for value in column.values(item)] for columns in (_NAMED, _OTHERS))
    return dict(zip(COLUMNS, (*named, *box_numbers(item.box), *others), strict=True))
