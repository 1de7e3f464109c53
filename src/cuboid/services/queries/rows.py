"""Found objects as rows of printed tables, of pages, and for JSON; the same for a store and for one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from cuboid.ground.core.sizes import size_text, unseen_text
from cuboid.services.queries.answers import FoundObject, Vector

SIDES = ("length_m", "width_m", "height_m")
CENTER = ("center_x_m", "center_y_m", "center_z_m")


def row_of(found: FoundObject, title: str, picture: bytes | None = None) -> dict[str, Any]:
    """Return an object of a place with the columns of `cuboid find` in a store.

    Parameters
    ----------
    found : FoundObject
    title : str
        Title of the place.
    picture : bytes, optional
    """
    seen, later = found.last_seen, found.later
    at = None if later is None else later.at
    return {
        "recording": title,
        "label": found.label,
        **dict(zip(("longest_m", "middle_m", "shortest_m"), sorted(found.size_m, reverse=True), strict=True)),
        **dict(zip(SIDES, found.size_m, strict=True)),
        **_place("center", found.center_m),
        "name": found.name,
        "state": found.state,
        "color": found.color,
        "colors": list(found.colors),
        "score": found.score,
        "probability": found.probability,
        "frames_seen": found.frames_seen,
        "first_frame": found.first_seen.frame,
        "last_frame": seen.frame,
        "last_seen": None if seen.time is None else datetime.fromisoformat(seen.time),
        "run": None,
        "last_recording": seen.recording,
        "camera": seen.camera,
        **_place("camera", seen.camera_m),
        "camera_distance_m": seen.distance_m,
        "later": None if later is None else later.state,
        "later_frame": None if at is None else at.frame,
        "later_recording": None if at is None else at.recording,
        **_sigmas(SIDES, found.size_sigma_m),
        **_sigmas(CENTER, found.center_sigma_m),
        "sides_seen": None if found.sides_seen is None else list(found.sides_seen),
        **({} if found.distance_m is None else {"distance_m": found.distance_m}),
        **({} if found.text_score is None else {"text_score": found.text_score}),
        **({} if picture is None else {"picture": picture}),
    }


def tag(row: Mapping[str, Any]) -> str:
    """Return recording, label and name of an object."""
    name = f" {row['name']}" if row.get("name") else ""
    return f"{row['recording']}#{row['label']}{name}"


def sigma_names(of: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of standard deviations of some columns in metres."""
    return tuple(f"{name.removesuffix('_m')}_sigma_m" for name in of)


def size_of(row: Mapping[str, Any], separator: str = " x ", *, errors: bool = False) -> str:
    """Return the size of an object in text, centimetres."""
    return size_text([row[side] for side in SIDES], _known_sigmas(row), separator=separator, errors=errors)


def unseen_of(row: Mapping[str, Any]) -> str:
    """Return "back not seen" if that is known of an object, else an empty text."""
    return unseen_text(row.get("sides_seen") or (), _known_sigmas(row))


def cells_of(row: Mapping[str, Any], *, errors: bool = False) -> list[str]:
    """Return the cells of an object in tables: name, size, position, color, probability, frames, last sighting, since.

    Parameters
    ----------
    row : mapping
    errors : bool
        Whether each size is followed by half its 95 % interval.
    """
    size = ", ".join(filter(None, (size_of(row, errors=errors), unseen_of(row))))
    likely = "" if row["probability"] is None else f"{row['probability']:.2f}"
    first = [tag(row), size, _text(row, "center"), " and ".join(row["colors"]), likely]
    seen = when(row["last_frame"], row.get("last_recording"), row["last_seen"])
    return [*first, str(row["frames_seen"]), seen, later_text(row, brief=True)]


def last_seen_lines(row: Mapping[str, Any]) -> list[str]:
    """Return what is known of an object since it was seen last, and where, when and from where that was."""
    seen = _by_camera(row)
    lines = [later_text(row), f"last seen at ({_text(row, 'center')}) in {seen}"]
    if row.get("camera_distance_m") is None:
        return lines
    return [*lines, f"{row['camera_distance_m']:.2f} m from the camera, which was at ({_text(row, 'camera')})"]


def seen_text(row: Mapping[str, Any]) -> str:
    """Return the frame, the time, the camera and the distance of the last sighting."""
    away = row.get("camera_distance_m")
    return _by_camera(row) + ("" if away is None else f", {away:.2f} m away")


def later_text(row: Mapping[str, Any], *, brief: bool = False) -> str:
    """Return what is known of an object after its last sighting, in words; brief for a column."""
    frame = row.get("later_frame")
    since = "" if frame is None else f" since {_when_in_full(frame, row.get('later_recording'), None)}"
    brief_texts = {"there": "still there", "gone": f"gone{since}", "not seen": f"not seen{since}", None: ""}
    texts = {
        "there": "still there at the end",
        "gone": f"looked for and gone{since}",
        "not looked at": "not looked at since",
        "not seen": f"in view{since}, but not seen: hidden, or not recognised",
        None: "not known since",
    }
    return (texts | brief_texts if brief else texts)[row.get("later")]


def when(frame: int | None, recording: int | None, time: datetime | None) -> str:
    """Return the time of a sighting; without one, its frame."""
    return _when_in_full(frame, recording, None) if time is None else f"{time.astimezone(UTC):%Y-%m-%d %H:%M:%S}"


def plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row ready for JSON, without its picture."""
    kept = {name: value for name, value in row.items() if name != "picture"}
    return {
        name: value.isoformat()
        if isinstance(value, datetime)
        else round(value, 6)
        if isinstance(value, float)
        else value
        for name, value in kept.items()
    }


def _by_camera(row: Mapping[str, Any]) -> str:
    of = f" of {row['camera']}" if row.get("camera") else ""
    return _when_in_full(row["last_frame"], row.get("last_recording"), row["last_seen"]) + of


def _when_in_full(frame: int | None, recording: int | None, time: datetime | None) -> str:
    of = "" if recording is None else f"recording {recording}, "
    clock = "" if time is None else f" ({time.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC)"
    return f"{of}frame {frame}{clock}" if frame is not None else f"{of}an unknown frame{clock}"


def _place(of: str, values: Vector | None) -> dict[str, float | None]:
    return dict(zip((f"{of}_x_m", f"{of}_y_m", f"{of}_z_m"), values or (None, None, None), strict=True))


def _known_sigmas(row: Mapping[str, Any]) -> list[float] | None:
    sigmas = [row.get(name) for name in sigma_names(SIDES)]
    return None if None in sigmas else sigmas  # type: ignore[return-value]  # no None is left


def _sigmas(of: Sequence[str], sigma_m: Vector | None) -> dict[str, float | None]:
    return dict(zip(sigma_names(of), sigma_m or (None,) * 3, strict=True))


def _text(row: Mapping[str, Any], of: str) -> str:
    return ", ".join(f"{row[f'{of}_{axis}_m']:z.2f}" for axis in "xyz")
