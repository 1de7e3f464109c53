# ruff: noqa: E501 - texts of the source stand here as they are.
"""The rules of the method that can be left out one by one, each as a change of the source that neutralises it."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

Change = tuple[str, str, str]


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule of the method.

    Attributes
    ----------
    name : str
    lines : int
        Lines of code that the rule takes, about, without docstrings and comments.
    changes : tuple of (str, str, str)
        File under `src/cuboid`, a text that stands there once, and what stands there without the rule.
    """

    name: str
    lines: int
    changes: tuple[Change, ...]


OBJECT_MAP, FITTING, BOXING = "method/objects/object_map.py", "method/objects/fitting.py", "method/objects/boxing.py"
BODIES, EXTENTS, OUTLINES = (
    "method/boxes/kernels/bodies.py",
    "method/boxes/kernels/extents.py",
    "method/surfaces/kernels/outlines.py",
)


RULES: tuple[Rule, ...] = (
    # Outlines.
    Rule(
        "outlines: ends alone",
        6,
        ((OUTLINES, "if to_end > max(1.0, END_FRACTION * (high - low)):", "if to_end < 0.0:"),),
    ),
    Rule(
        "outlines: color",
        10,
        ((OUTLINES, "edge = edge or change >= EDGE_LEVELS", "edge = False"),),
    ),
    Rule(
        "outlines: hole inwards",
        11,
        ((OUTLINES, "return FREE if edge or inner_steps + n <= reach else UNSURE, b", "return FREE, b"),),
    ),
    # Segments.
    Rule(
        "segments: prior of the map",
        45,
        (("runs/tracking/posed_tracker.py", "prior = prior_of(objects, voxels.owner, weighed)", "prior = np.ones(len(proposals))"),),
    ),
    Rule(
        "segments: two surfaces join",
        14,
        (("method/surfaces/kernels/pieces.py", "become[k] = m if joins else k", "become[k] = m if joins and m == k else k"),),
    ),
    Rule(
        "segments: parts beside",
        8,
        (
            (
                OBJECT_MAP,
                "elif part[i] >= 0 and not self._are_separate(frame_segments, i, partner.get(part[i])):",
                "elif part[i] >= 0:",
            ),
        ),
    ),
    Rule(
        "holes: color",
        20,
        (("ground/core/kernels/holes.py", "total = cost + (step + np.float32(change) * per_level)", "total = cost + step"),),
    ),
    # What two objects are to each other.
    Rule(
        "pairs: held by another",
        75,
        ((FITTING, "holder = find_attachment(entry, *rests, neighbours, self._voxels) or find_coaxial(", "holder = find_coaxial("),),
    ),
    Rule("pairs: shared room", 12, ((OBJECT_MAP, "        self._add_overlaps(objects, novelty, separate)\n", ""),)),
    Rule(
        "pairs: hollow",
        14,
        (("method/objects/store/objects.py", "found[i, j] = not _is_inside_hollow(entries[i], others[j])", "pass"),),
    ),
    Rule(
        "pairs: novelty",
        4,
        (
            (
                OBJECT_MAP,
                "novelty = seen.weight",
                "novelty = 1.0",
            ),
        ),
    ),
    # Structure.
    Rule(
        "structure: plane beside its top",
        8,
        ((FITTING, "if self._planes.is_extended_by_plane(entry.box):", "if False:"),),
    ),
    Rule(
        "structure: plane on its top",
        2,
        ((FITTING, "return self._planes.has_plane_on_top(entry.box) and not ends_above(entry.outline)", "return False"),),
    ),
    Rule(
        "structure: bears a plane twice",
        2,
        (
            (
                FITTING,
                "if furniture or too_large(box, self._config):",
                "if too_large(box, self._config):",
            ),
        ),
    ),
    # Which points are an object's, and what it stands on.
    Rule(
        "points: rim of the support",
        80,
        (
            (
                FITTING,
                "above_rim = above_support_rim(points, normal, offset, self._voxels.voxel_m)",
                "above_rim = np.ones(len(points), bool)",
            ),
        ),
    ),
    Rule("points: above the plane", 6, ((FITTING, "        rows, points = rows[above], points[above]\n", ""),)),
    Rule(
        "support: asked again",
        2,
        ((FITTING, "if plane is not None and rests is not None and box.foot_m(*rests) > DRIFT_M:", "if False:"),),
    ),
    Rule(
        "seats",
        85,
        (
            (
                FITTING,
                "if plane is not None and continuing < STRUCTURE_SIDES and not supports_plane and not holder:",
                "if False:",
            ),
            (
                FITTING,
                "plane = self._planes.supporting_plane(points[:: 1 + len(points) // SAMPLE_POINTS], plane)",
                "pass",
            ),
        ),
    ),
    Rule(
        "seats: plane beneath",
        14,
        (
            (
                FITTING,
                "plane = self._planes.supporting_plane(points[:: 1 + len(points) // SAMPLE_POINTS], plane)",
                "pass",
            ),
        ),
    ),
    # Boxes.
    Rule(
        "box: hidden foot",
        24,
        (
            (
                FITTING,
                "box = seen_box if rests is None else with_hidden_foot(seen_box, *rests, parts, self._voxels, max_height_m)",
                "box = seen_box",
            ),
        ),
    ),
    Rule(
        "box: foot always",
        20,
        (
            (
                "method/boxes/hidden.py",
                "surface_m = hidden_foot_m(box, normal, offset, near, voxels)",
                "surface_m = 0.0",
            ),
        ),
    ),
    Rule("box: far side", 50, ((BOXING, "return with_hidden(box, points, *plane, others, self._voxels)", "return box"),)),
    Rule("box: denoised", 45, ((BOXING, "points, noise_m = denoised(points, trust, eye, noise_m, voxel_m)", "pass"),)),
    Rule(
        "box: as deep as wide",
        17,
        ((BOXING, "return as_deep_as_wide(box, eye, others, 2.0 * voxel_m), noise_m", "return box, noise_m"),),
    ),
    Rule(
        "box: faces",
        38,
        (
            (BOXING, "            round_box = to_faces(round_box, points, trust, noise_m, top_alone=True)\n", ""),
            (BOXING, "        box = to_faces(box, points, trust, noise_m, top_alone=False)\n", ""),
        ),
    ),
    Rule(
        "box: sides that fit",
        40,
        ((EXTENTS, "    if points.shape[0] == 0:\n        return best\n", "    if points.shape[0] >= 0:\n        return best\n"),),
    ),
    Rule(
        "box: disc",
        36,
        (("method/boxes/kernels/resting.py", "    if radius > 0.0:\n", "    if radius > 1e9:\n"),),
    ),
    Rule(
        "box: trust",
        3,
        (
            (
                BOXING,
                "trust = np.minimum(hits, _middle(hits)) * np.minimum(precision, usual)",
                "trust = np.ones(len(hits))",
            ),
        ),
    ),
    # Round bodies.
    Rule(
        "round: all",
        300,
        (
            (
                BOXING,
                "round_box = revolved(box, points, trust, plane, noise_m, self._voxels.voxel_m, STRAY_FRACTION)",
                "round_box = None",
            ),
        ),
    ),
    Rule(
        "round: trimmed fit",
        30,
        (
            (
                "method/boxes/revolved.py",
                "find_body(*seen, True, center, part) or find_body(*seen, False, center, part)",
                "find_body(*seen, False, center, part)",
            ),
        ),
    ),
    Rule(
        "round: fit of all points",
        3,
        (
            (
                "method/boxes/revolved.py",
                "find_body(*seen, True, center, part) or find_body(*seen, False, center, part)",
                "find_body(*seen, True, center, part)",
            ),
        ),
    ),
    Rule(
        "round: along what sticks out",
        14,
        (("method/boxes/revolved.py", "        towards = _lengthwise(plan[beyond] - center, trust[beyond])\n", ""),),
    ),
    Rule("round: rim all round", 12, ((BODIES, "rim[k] = out > RIM_FRACTION * sectors_seen", "rim[k] = False"),)),
    Rule(
        "round: better than a rectangle",
        12,
        ((BODIES, "if spread >= off_rectangle(plan, weights, rectangle):", "if spread < 0.0:"),),
    ),
    Rule(
        "round: same all round",
        15,
        ((BODIES, "return sectors_read >= MIN_ARC * SECTORS and not high - low > limit", "return sectors_read >= MIN_ARC * SECTORS"),),
    ),
    Rule(
        "round: beside neighbours",
        1,
        ((BOXING, "            and is_clear_of(round_box, others)\n", ""),),
    ),
    # Planes and up.
    Rule(
        "planes: lids",
        17,
        (
            (
                "method/surfaces/planes.py",
                "if is_lid(plane, self._config.max_size_m**2, partial(self._at, plane.mean[None])):",
                "if False:",
            ),
        ),
    ),
    Rule(
        "planes: gaps",
        15,
        (
            (
                "method/surfaces/plane_rules.py",
                "    return np.asarray(members[group == np.argmax(np.bincount(group, area_m2[members]))])",
                "    return np.asarray(members[group >= 0])",
            ),
        ),
    ),
    Rule(
        "planes: as the frame sees them",
        32,
        (("method/surfaces/planes.py", "adapted = as_seen.get(plane.identity)", "adapted = None"),),
    ),
    Rule("planes: level", 11, (("method/surfaces/planes.py", "        self._level()\n", ""),)),
    Rule(
        "up: faces of things",
        6,
        (("method/surfaces/standing.py", "faces = area_m2 <= FACE_FRACTION * area_m2[:, None]", "faces = area_m2 < 0.0 * area_m2[:, None]"),),
    ),
    Rule("up: camera turns about it", 4, (("method/surfaces/up.py", "self.seen[:, 4] * self._constancy(self.seen[:, :3])", "self.seen[:, 4]"),)),
    Rule("up: level in the images", 8, (("method/surfaces/up.py", "level = self._level_in_images()", "level = None"),)),
    # Sightings.
    Rule(
        "sighting: blended rectangle",
        8,
        (
            (
                "method/objects/visibility.py",
                "rect_xyxy = blended_rectangle(view.rect_xyxy, rect.get(entry.number))",
                "rect_xyxy = view.rect_xyxy",
            ),
        ),
    ),
    Rule(
        "sighting: edges of points",
        14,
        ((EXTENTS, "    if high <= low or values.size == 0:\n", "    if high <= low or values.size >= 0:\n"),),
    ),
    Rule(
        "sighting: color where no depth",
        6,
        (("method/objects/kernels/sightings.py", "reading, row, same = depth[y, x], slots[y, x], True", "reading, row, same = depth[y, x], slots[y, x], False"),),
    ),
    Rule(
        "sighting: down to the foot",
        12,
        (("method/objects/kernels/sightings.py", "total = count + (count + 1) // 2", "total = count"),),
    ),
)  # fmt: skip


def write_variant(source: Path, rules: Iterable[Rule], folder: Path) -> None:
    """Write the package `source` into a folder, without some of its rules.

    Raises
    ------
    ValueError
        A text that a rule changes does not stand in its file once.
    """
    target = folder / source.name
    shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
    for rule in rules:
        for name, old, new in rule.changes:
            file = target / name
            text = file.read_text()
            if text.count(old) != 1:
                raise ValueError(f"{rule.name}: stands {text.count(old)} times in {name}: {old!r}")
            file.write_text(text.replace(old, new))
