"""Several recordings of one place; in between, objects move, turn, go and come, and light and path change.

::

    output/
      visit-1/  visit-2/  ...     plain recordings with their truth; a thing has the same id in all of them
      visits.json                 what happened between them
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.lab.synthetic.draft import OBJECT_GAP_M, Draft, finish
from cuboid.lab.synthetic.kinds import FRAMES, WAYS, make_scene
from cuboid.lab.synthetic.looks import STYLES, dressed, materials_of
from cuboid.lab.synthetic.mesh import shift, turn
from cuboid.lab.synthetic.paths import CAMERAS
from cuboid.lab.synthetic.placement import Arrangement
from cuboid.lab.synthetic.recording import Progress, Shown, render_recording
from cuboid.lab.synthetic.scene import Scene, SceneObject, require_known
from cuboid.lab.synthetic.shapes import Model
from cuboid.results.files.pending import write_whole
from cuboid.results.files.text import LENGTH, rounded, rounded_list

VISITS = "visits.json"
# Number of objects that move between two visits; in addition, one turns in place, one is removed, one is added.
MOVED = 2
# Minimum distance of a moved object from its old place, metres.
MIN_MOVE_M = 0.15
# Maximum displacement of the centre of an object that turns in place, metres.
TURNED_M = 0.05
# Maximum displacement of the lamp between visits, metres.
LAMP_M = (0.9, 0.9, 0.15)
# Seed offset per visit: each visit has its own random numbers.
VISIT_SEED = 100_003


def make_visits(
    kind: str,
    seed: int,
    count: int,
    *,
    frames: int | None = None,
    camera: str | None = None,
    meshes: Sequence[Model] = (),
    style: str = "plain",
) -> list[Scene]:
    """Make a scene and its changed versions at later visits; the same arguments make the same scenes.

    Parameters
    ----------
    kind : str
        One of `WAYS`.
    seed : int
    count : int
        Number of visits, including the first one.
    frames, camera, meshes, style
        As for `make_scene`.

    Raises
    ------
    InputError
        The kind, the camera or the style is unknown, or the kind has no visits.
    """
    require_known("style", style, STYLES)
    scenes = [make_scene(kind, seed, frames=frames, camera=camera, meshes=meshes)]
    if kind not in WAYS:
        raise InputError(f"a scene of the kind '{kind}' cannot be visited again; there are {', '.join(WAYS)}")
    last_id = max(body.id for body in scenes[0].objects)
    for visit in range(2, count + 1):
        scene, last_id = _next(scenes, kind, seed, visit, last_id, frames or FRAMES[kind], camera)
        scenes.append(scene)
    return scenes if style == "plain" else [dressed(scene, seed, materials_of(meshes)) for scene in scenes]


def _next(
    scenes: Sequence[Scene], kind: str, seed: int, visit: int, last_id: int, frames: int, camera: str | None
) -> tuple[Scene, int]:
    """Return the scene of the next visit, and the last object id in use."""
    before = scenes[-1]
    rng = np.random.default_rng([seed, sorted(WAYS).index(kind), visit])
    place = Arrangement(before.surfaces, rng, before.objects)
    free = [body.id for body in before.objects if not body.touches]
    chosen = [free[int(k)] for k in rng.permutation(len(free))]
    ghosts = [_moved(place, number, rng) for number in chosen[:MOVED]]
    if chosen[MOVED : MOVED + 1]:
        _turn(place, chosen[MOVED], rng)
    ghosts += [place.take(number) for number in chosen[MOVED + 1 : MOVED + 2]]
    drawn = tuple(CAMERAS)[int(rng.integers(len(CAMERAS)))]
    draft = Draft(rng, frames, camera or drawn, (), list(before.furniture), place, np.empty((0, 6)))
    if (
        place.put(draft.models(1)[0], int(rng.integers(len(before.surfaces))), OBJECT_GAP_M, 0.85, last_id + 1)
        is not None
    ):
        last_id += 1
    WAYS[kind](draft)
    focal = float(rng.uniform(525, 600))
    name = f"synthetic {kind} {seed}, visit {visit}"
    scene = finish(draft, name, kind, seed + VISIT_SEED * (visit - 1), before.T_world_room, focal)
    light = scenes[0].light.moved(rng.uniform(-1, 1, 3) * LAMP_M)
    return replace(scene, light=light, ghosts=tuple(body for body in ghosts if body is not None)), last_id


def _moved(place: Arrangement, number: int, rng: np.random.Generator) -> SceneObject | None:
    """Move an object to another place; return its old state, or None if there is no room."""
    old = place.take(number)
    for _ in range(20):
        new = place.put(old.model, int(rng.integers(len(place.surfaces))), OBJECT_GAP_M, 0.85, number)
        if new is None:
            break
        if np.linalg.norm(new.T_room_model[:3, 3] - old.T_room_model[:3, 3]) >= MIN_MOVE_M:
            return old
        place.take(number)
    place.restore(old)
    return None


def _turn(place: Arrangement, number: int, rng: np.random.Generator) -> None:
    """Turn an object in place, as far as possible without touching another one."""
    old = place.take(number)
    angle = float(rng.uniform(0.5, np.pi))
    center = old.T_room_model[:3, 3]
    new = replace(old, T_room_model=shift(tuple(center)) @ turn(angle) @ shift(tuple(-center)) @ old.T_room_model)
    place.restore(new if place.fits(new, OBJECT_GAP_M / 3) else old)


def render_visits(
    scenes: Sequence[Scene],
    path: PathLike,
    *,
    force: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Render visits, each into its own recording, and write the changes between them.

    Parameters
    ----------
    scenes : sequence of Scene
        Output of `make_visits`.
    path : path
        The folder of all visits.
    force : bool
        Whether existing synthetic visits are replaced.
    progress : callable, optional
        Called with the number of finished frames and the total number.
    **options
        As for `render_recording`.

    Returns
    -------
    dict
        Contents of `visits.json`.

    Raises
    ------
    InputError
        An argument is unknown or out of range.
    OutputError
        The folder exists and `force` is False, or it cannot be written.
    """
    path = as_path(path)
    if path.exists() and not (force and (path / VISITS).is_file()):
        raise OutputError(f"{path}: exists; --force replaces made visits that lie there")
    frames, done = sum(scene.frames for scene in scenes), 0
    document: dict[str, Any] = {"format": "cuboid-visits", "version": 1, "name": scenes[0].name, "visits": []}
    for number, scene in enumerate(scenes, 1):
        shown = render_recording(
            scene, path / f"visit-{number}", force=force, progress=_from(progress, done, frames), **options
        )
        done += scene.frames
        changes = changes_between(scenes[number - 2], scene, shown) if number > 1 else []
        document["visits"].append({"recording": f"visit-{number}", "changes": changes})
    write_whole(path / VISITS, json.dumps(document, indent=1) + "\n")
    return document


def _from(progress: Progress | None, done: int, frames: int) -> Progress | None:
    """Return the progress callback for one of several recordings."""
    return None if progress is None else lambda frames_done, _: progress(done + frames_done, frames)


def changes_between(before: Scene, after: Scene, shown: Shown) -> list[dict[str, Any]]:
    """Return the change of each object between two visits, by id.

    Each has ``id``, ``name``, ``change`` (unchanged, moved, gone, new), ``judged``, the old and new place (``from`` and
    ``to``), and the number of frames of the later visit that show these places (``empty_frames``, ``seen_frames``).
    """
    old, new = ({body.id: body for body in scene.objects} for scene in (before, after))
    rows = []
    for number in sorted({*old, *new}):
        body = new.get(number, old.get(number))
        assert body is not None
        first = before.box(old[number]).center if number in old else None
        last = after.box(new[number]).center if number in new else None
        moved = 0.0 if first is None or last is None else float(np.linalg.norm(last - first))
        change = "moved" if moved > TURNED_M else "unchanged"
        if first is None or last is None:
            change = "new" if first is None else "gone"
        rows.append(
            {
                "id": number,
                "name": body.model.name,
                "change": change,
                "judged": body.judged,
                "from": None if first is None else rounded_list(first, LENGTH),
                "to": None if last is None else rounded_list(last, LENGTH),
                "metres": rounded(moved, LENGTH),
                "empty_frames": shown.ghosts.get(number, 0),
                "seen_frames": shown.objects.get(number, 0),
            }
        )
    return rows
