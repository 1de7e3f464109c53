"""The live cameras of a rig as one source of frames, in the order of their times.

Each camera has its thread and its queue. A frame waits until every other camera has a later one, or for `HOLD_S`. A
camera that fails or falls silent ends alone, and the others go on.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.frame import Frame, Rig, RigCamera
from cuboid.ground.core.limits import FRAMES_WAITING
from cuboid.ground.core.paths import PathLike, as_path, file_name, refuse_same_file_names
from cuboid.ground.formats import rig_file
from cuboid.ground.formats.folder import writing
from cuboid.ground.formats.rig_file import FIXED, RigDocument
from cuboid.inputs.cameras.driver import CAMERAS, Driver, Shot
from cuboid.inputs.cameras.latest import POLL_S
from cuboid.inputs.cameras.live import CAMERA_SILENCE_S, LiveCamera, camera_from
from cuboid.inputs.recordings.rig import RIG_FILE, late_warnings, read_rig, rig_settings

# A frame waits this long at most for an earlier one of another camera, seconds: the delays of two cameras, from the
# exposure to the arrival, differ by less.
HOLD_S = 0.1
# Frames of a camera that wait, at most: those of the hold at 90 Hz besides those of a single camera.
CAPACITY = FRAMES_WAITING + round(90 * HOLD_S)
# Clocks of two cameras are one clock if their times at the same moment differ by less than this, seconds: more than
# any delay, and much less than the time between the starts of two devices.
SAME_CLOCK_S = 0.5
# First frames of a camera with its own clock, from which its time is found; they are dropped.
CLOCK_FRAMES = 10
# Digits of times in seconds: those of recordings, so that a recorded run has the same order.
MICROSECOND = 6


class LiveRig:
    """Frames of several live cameras; `open_cameras` makes it. A context manager that is iterated over once.

    Attributes are those of `LiveCamera`; intrinsics and units are those of the first camera.

    Attributes
    ----------
    rig : Rig
    record : path or None
        Folder with a ``rig.json`` and one recording for each camera; complete when the iteration has ended.
    camera_time_s : float
        Time of the present frame on the clock of its camera, as the driver gave it, seconds.
    """

    def __init__(
        self,
        document: RigDocument,
        cameras: Sequence[LiveCamera],
        changed: threading.Condition,
        record: PathLike | None = None,
    ) -> None:
        names = tuple(entry.name for entry in document.cameras)
        parts = tuple(RigCamera(name, one.intrinsics) for name, one in zip(names, cameras, strict=True))
        poses = {entry.name: entry.pose for entry in document.cameras if entry.pose is not None}
        self.rig, self.record = Rig(document.kind, parts, poses), None if record is None else as_path(record)
        self.name = ", ".join(names)
        self.intrinsics = cameras[0].intrinsics
        self.depth_units_per_metre = cameras[0].depth_units_per_metre
        self.has_poses = document.kind == FIXED or (not poses and all(one.has_poses for one in cameras))
        if not (self.has_poses or poses):
            raise InputError("the cameras give no poses; a moving rig then needs the 'T_rig_camera' of each camera")
        self.warnings: list[str] = []
        self.idle: Callable[[], None] = lambda: None
        self.camera_time_s = 0.0
        self._document, self._cameras, self._changed = document, tuple(cameras), changed
        self._times_s: list[list[float]] = [[] for _ in cameras]
        self._sequence: list[int] = []
        self._late = 0
        self._ended, self._stepped_back = [False] * len(cameras), [False] * len(cameras)
        self._clocks = [_Clock() for _ in cameras]
        self._last = (float("-inf"), 0)

    @property
    def dropped(self) -> int:
        """Number of frames that were not taken in time, or came after a later one of another camera."""
        return self._late + sum(camera.dropped for camera in self._cameras)

    def settings(self) -> dict[str, Any]:
        """Return the entry of `run.json`; see `rig_settings`."""
        return rig_settings(self.rig, [], self._times_s, self._sequence)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with ExitStack() as stack:
            for camera in self._cameras:
                stack.push(camera)
        self.close()

    def close(self) -> None:
        """End the iteration after the current frame; may be called from any thread or signal handler."""
        for camera in self._cameras:
            camera.close()

    def __iter__(self) -> Iterator[Frame]:
        """Iterate over the frames of all cameras until each has ended or `close` is called.

        Raises
        ------
        InputError
            No camera returned a frame.
        OutputError
            The recording cannot be written.
        """
        index = 0
        with ExitStack() as stack:
            stack.callback(self._finish)
            frame_of = [stack.enter_context(camera.capturing()) for camera in self._cameras]
            for k, shot, time_s in self._shots():
                frame = frame_of[k](replace(shot, timestamp_s=time_s))
                if frame is None:
                    continue
                self.camera_time_s = shot.timestamp_s
                self._times_s[k].append(frame.timestamp_s)
                self._sequence.append(k)
                camera = self.rig.cameras[k]
                pose = self.rig.T_rig_camera[camera.name] if self.rig.kind == FIXED else frame.T_world_camera
                yield replace(frame, index=index, camera=camera, T_world_camera=pose if self.has_poses else None)
                index += 1
        if index == 0 and self.warnings:
            raise InputError(self.warnings[-1])

    def _shots(self) -> Iterator[tuple[int, Shot, float]]:
        """Iterate over the images of all cameras in the order of their times: number of the camera, image, time."""
        while True:
            self._name_ended()
            with self._changed:
                k = self._next()
                if k is None:
                    if all(camera.queue.exhausted for camera in self._cameras):
                        break
                    self._changed.wait(HOLD_S / 10 if any(self._heads()) else POLL_S)
                    k = self._next()
                shot = None if k is None else self._cameras[k].queue.get()
            if k is None or shot is None:
                self.idle()
                continue
            self._name_step_back(k, shot)
            time_s = self._clocks[k].time_s(shot)
            if time_s is None:
                continue
            if (time_s, k) < self._last:
                self._late += 1
                continue
            self._last = time_s, k
            yield k, shot, time_s
        self._name_ended()

    def _heads(self) -> list[Shot | None]:
        return [camera.queue.head() for camera in self._cameras]

    def _next(self) -> int | None:
        """Return the number of the camera whose frame comes next; None while another camera may have an earlier one."""
        heads = self._heads()
        there = [(k, head) for k, head in enumerate(heads) if head is not None]
        if not there:
            return None
        self._set_clocks(there)
        k, first = min(there, key=lambda one: (self._clocks[one[0]].shifted_s(one[1]), one[0]))
        awaited = [
            camera.queue
            for head, camera in zip(heads, self._cameras, strict=True)
            if head is None and not camera.queue.exhausted
        ]
        held = any(queue.paced for queue in awaited) or time.monotonic() - first.arrived_s < HOLD_S
        return None if awaited and held else k

    def _set_clocks(self, there: Sequence[tuple[int, Shot]]) -> None:
        """Compare the clock of each camera, at its first frame, with that of the first camera that gave one."""
        for k, shot in there:
            if self._clocks[k].base_s is not None:
                continue
            others = [clock for clock in self._clocks if clock.base_s is not None and clock.is_reference]
            self._clocks[k].begin(shot, others[0] if others else None, paced=self._cameras[k].queue.paced)
            if self._clocks[k].frames_left:
                self.warnings.append(
                    f"camera {self.rig.cameras[k].name} has its own clock; its times follow from the arrival of its "
                    "frames, to some hundredths of a second"
                )

    def _name_step_back(self, k: int, shot: Shot) -> None:
        """Report, once for each camera, that its clock steps back: its frames are late until it has caught up."""
        step_s = self._clocks[k].step_back_s(shot)
        if step_s > 0 and not self._stepped_back[k]:
            self._stepped_back[k] = True
            self.warnings.append(
                f"camera {self.rig.cameras[k].name}: its clock stepped back by {step_s:.2f} s; frames that are then "
                "earlier than the last one of any camera are dropped"
            )

    def _name_ended(self) -> None:
        """Report each camera that ended by itself since the last call, while others go on."""
        for k, camera in enumerate(self._cameras):
            if not self._ended[k] and camera.queue.exhausted:
                self._ended[k] = True
                if camera.failure:
                    self.warnings.append(f"camera {self.rig.cameras[k].name}: {camera.failure}")

    def _finish(self) -> None:
        """Collect the warnings, and complete the recording."""
        names = [camera.name for camera in self.rig.cameras]
        for name, camera in zip(names, self._cameras, strict=True):
            known = f"camera {name}: {camera.failure}"
            lines = [f"camera {name}: {line}" for line in camera.warnings]
            self.warnings += [line for line in lines if line != known or known not in self.warnings]
        shown = [(name, times) for name, times in zip(names, self._times_s, strict=True) if times]
        if shown:
            self.warnings += late_warnings([name for name, _ in shown], [times for _, times in shown])
        if self.record is not None and shown:
            self._write_rig(self.record, [name for name, _ in shown])

    def _write_rig(self, folder: Path, names: Sequence[str]) -> None:
        """Write the ``rig.json`` of the recorded cameras."""
        cameras: list[dict[str, Any]] = []
        for entry in self._document.cameras:
            if entry.name in names:
                serial = {} if entry.serial is None else {"serial": entry.serial}
                pose = {} if entry.T_rig_camera is None else {"T_rig_camera": entry.T_rig_camera}
                cameras.append({"name": entry.name, "recording": file_name(entry.name), **serial, **pose})
        document = {"format": rig_file.FORMAT, "version": rig_file.VERSION, "kind": self.rig.kind, "cameras": cameras}
        with writing(folder):
            (folder / RIG_FILE).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


class _Clock:
    """The clock of a camera: its times in those of the reference, the first camera that gave a frame."""

    def __init__(self) -> None:
        # Arrival less time of a frame: the smallest one so far, of the frame with the least delay.
        self.base_s: float | None = None
        self.is_reference = False
        self.frames_left = 0
        self.shift_s = 0.0
        self._last_s = float("-inf")
        self._reference: _Clock | None = None

    def begin(self, shot: Shot, reference: _Clock | None, *, paced: bool) -> None:
        """Take the first frame of the camera, which remains in the queue."""
        self.base_s = shot.arrived_s - shot.timestamp_s
        self.is_reference, self._reference = reference is None, reference
        if reference is not None and reference.base_s is not None and not paced:
            self.frames_left = CLOCK_FRAMES if abs(self.base_s - reference.base_s) > SAME_CLOCK_S else 0
            self.shift_s = self.base_s - reference.base_s if self.frames_left else 0.0

    def shifted_s(self, shot: Shot) -> float:
        """Return the time of a frame on the clock of the reference, seconds."""
        return round(shot.timestamp_s + self.shift_s, MICROSECOND)

    def step_back_s(self, shot: Shot) -> float:
        """Return the time by which the clock is behind that of the frame before, seconds; not positive if it is not."""
        step_s, self._last_s = self._last_s - shot.timestamp_s, shot.timestamp_s
        return step_s

    def time_s(self, shot: Shot) -> float | None:
        """Return the time of the next frame; None if it serves only to find the time of the clock."""
        assert self.base_s is not None
        self.base_s = min(self.base_s, shot.arrived_s - shot.timestamp_s)
        if self.frames_left and self._reference is not None and self._reference.base_s is not None:
            self.frames_left -= 1
            self.shift_s = self.base_s - self._reference.base_s
            return None
        return self.shifted_s(shot)


def named_cameras(text: str) -> list[str]:
    """Return the cameras that a text names: each begins with the name of a driver, and its options follow."""
    found: list[list[str]] = []
    for item in filter(None, text.split(",")):
        begins = "=" not in item.partition(":")[0] and item.partition(":")[0] in CAMERAS.names()
        if begins or not found:
            found.append([item])
        else:
            found[-1].append(item)
    return [",".join(items) for items in found]


def cameras_of(text: str, file: Path, rig: RigDocument) -> list[str]:
    """Return the live camera of each camera of a rig, in the order of the file.

    One driver without a device stands for all cameras, with the ``serial`` of each. Named devices that are all in the
    file are put in its order.

    Raises
    ------
    InputError
        There is not one live camera for each camera of the rig.
    """
    named, serials = named_cameras(text), [entry.serial for entry in rig.cameras]
    if named == [text] and text in CAMERAS.names() and None not in serials and len(serials) > 1:
        return [f"{text}:{serial}" for serial in serials]
    if len(named) != len(rig.cameras):
        names = ", ".join(entry.name for entry in rig.cameras)
        counted = f"{len(named)} live camera{'s were' if len(named) > 1 else ' was'} named"
        raise InputError(f"{file}: has {len(rig.cameras)} cameras ({names}), but {counted}")
    twice = next((one for one, other in pairwise(sorted(named)) if one == other), None)
    if twice is not None:
        raise InputError(f"--camera: {twice} is named twice; name the device of each, as in realsense:SERIAL")
    devices = [one.partition(":")[2].partition(",")[0].rpartition("=")[2] for one in named]
    if sorted(devices) == sorted(str(serial) for serial in serials):
        return [named[devices.index(str(serial))] for serial in serials]
    return named


def open_cameras(cameras: str, rig: PathLike, *, record: PathLike | None = None, form: str = "plain") -> LiveRig:
    """Open the live cameras of a rig.

    Parameters
    ----------
    cameras : str
        The cameras as in `open_camera`, one after the other, in the order of the file: "realsense:831612070538,
        realsense:829212070220" without the space; or the name of one driver, if the file has each `serial`.
    rig : path
        The ``rig.json``, or a folder with one.
    record : path, optional
        Folder in which the frames are recorded: a ``rig.json`` and one recording for each camera.
    form : {"plain", "mcap"}
        Format of the recorded frames.

    Raises
    ------
    InputError
        The file is malformed, or a camera cannot be opened.
    OutputError
        `record` exists, or two cameras would be recorded in one folder.
    MissingExtraError
        A driver needs a package that is not installed.
    """
    file, document = read_rig(as_path(rig))
    folder, changed = None if record is None else as_path(record), threading.Condition()
    if folder is not None and folder.exists():
        raise OutputError(f"{record}: exists; frames are recorded into a new folder")
    if folder is not None:
        refuse_same_file_names([entry.name for entry in document.cameras])
    with ExitStack() as opened:
        found = []
        for entry, camera in zip(document.cameras, cameras_of(cameras, file, document), strict=True):
            place = None if folder is None else folder / file_name(entry.name)

            def make(driver: Driver, place: Path | None = place) -> LiveCamera:
                return LiveCamera(
                    driver, record=place, form=form, silence_s=CAMERA_SILENCE_S, capacity=CAPACITY, changed=changed
                )

            found.append(opened.enter_context(camera_from(camera, make)))
        live = LiveRig(document, found, changed, folder)
        opened.pop_all()
    return live
