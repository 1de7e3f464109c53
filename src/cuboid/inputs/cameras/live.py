"""A live camera as a source of frames: the driver in its own thread, a short queue, frames for the tracker.

If the tracker is too slow, frames are dropped, the oldest first, and counted, so that the tracker never gets old
frames.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Self

from cuboid.ground.core.errors import CuboidError, FrameError, InputError, OutputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.limits import FRAMES_WAITING
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.inputs.cameras.driver import CAMERAS, Driver, Shot, StreamEndedError
from cuboid.inputs.cameras.latest import FORMS, POLL_S, LatestQueue, keeping
from cuboid.inputs.readers import calibration as calibrations
from cuboid.inputs.readers.images import depth_in_metres

# Time without frames after which a camera counts as gone, seconds; most need one or two seconds to start.
CAMERA_SILENCE_S = 10.0
# The option that says which of several devices is meant; of other cameras it is "serial".
DEVICE_OPTIONS = {"oak": "id", "record3d": "id", "ros2": "color"}


class LiveCamera:
    """Frames of a live camera, made by `cuboid.open_camera`: a context manager that is iterated over once.

    Attributes
    ----------
    name : str
        Name in messages.
    intrinsics : Intrinsics
        Intrinsics of the frames, which are undistorted and have depth aligned to color.
    depth_units_per_metre : float
    has_poses : bool
        Whether frames come with a camera pose.
    record : path or None
        Folder in which the frames are recorded; it appears when the iteration has ended.
    warnings : list of str
        Problems during the iteration, one line each.
    idle : callable
        Called repeatedly while the iteration waits for a frame.
    queue : LatestQueue of Shot
        The images that wait.
    """

    def __init__(
        self,
        driver: Driver,
        *,
        record: PathLike | None = None,
        form: str = "plain",
        silence_s: float = CAMERA_SILENCE_S,
        capacity: int = FRAMES_WAITING,
        changed: threading.Condition | None = None,
    ) -> None:
        if form not in FORMS:
            raise InputError(f"a camera is recorded as {' or '.join(FORMS)}, got '{form}'")
        self.record = None if record is None else as_path(record)
        if self.record is not None and self.record.exists():  # raised now, not after an hour of recording
            raise OutputError(f"{record}: exists; frames are recorded into a new folder")
        self.name = driver.name
        self.has_poses = driver.has_poses
        self.depth_units_per_metre = driver.depth_units_per_metre
        self.warnings: list[str] = []
        self.idle: Callable[[], None] = lambda: None
        self._driver, self._form, self._silence_s = driver, form, silence_s
        self._prepare(Path(driver.name))
        self.queue: LatestQueue[Shot] = LatestQueue(capacity, paced=driver.paced, changed=changed)
        self._closing = threading.Event()
        self._failure = ""
        self._count = 0
        self._unusable: list[str] = []
        self._thread: threading.Thread | None = None

    def _prepare(self, name: Path) -> None:
        calibration = self._driver.calibration
        if calibration.size is None:
            raise InputError(f"{name}: does not say how large its images are")
        self.intrinsics: Intrinsics = calibrations.for_size(calibration, *calibration.size, name)
        self._undistort = calibrations.undistortion(calibration, calibration.size, name)
        self._register = calibrations.registration(calibration, self.intrinsics, name)

    @property
    def dropped(self) -> int:
        """Number of frames that were not taken in time."""
        return self.queue.dropped

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
        if self._thread is not None:
            self._thread.join(timeout=min(self._silence_s, CAMERA_SILENCE_S))
        self._driver.close()

    def close(self) -> None:
        """End the iteration after the current frame; may be called from any thread or signal handler."""
        self._closing.set()
        self.queue.stop()

    def __iter__(self) -> Iterator[Frame]:
        """Iterate over frames until the camera ends or `close` is called.

        Raises
        ------
        InputError
            The camera returned no frame.
        OutputError
            The recording cannot be written.
        """
        with self.capturing() as frame_of:
            while (shot := self.queue.get(self.idle)) is not None:
                frame = frame_of(shot)
                if frame is not None:
                    yield frame
        if self._count == 0 and self.warnings:
            raise InputError(self.warnings[-1])

    @contextmanager
    def capturing(self) -> Iterator[Callable[[Shot], Frame | None]]:
        """Capture images into `queue`; yield a function that returns the frame of the next one, and records it.

        The function returns None for an unusable image. At the end, problems are in `warnings`.
        """
        if self._thread is not None:
            raise RuntimeError("a live camera can be iterated over once")
        self._thread = threading.Thread(target=self._capture, name="cuboid-camera", daemon=True)
        self._thread.start()
        with ExitStack() as stack:
            keep = None
            if self.record is not None:
                place = (self.record, self._form, self.intrinsics, self.depth_units_per_metre)
                keep = stack.enter_context(keeping(*place, self._driver.calibration.depth_camera))
            stack.callback(self._tell)
            stack.callback(self.close)

            def frame_of(shot: Shot) -> Frame | None:
                frame = self._frame(self._count, shot)
                if frame is not None:
                    if keep is not None:
                        keep(frame)
                    self._count += 1
                return frame

            yield frame_of

    @property
    def failure(self) -> str:
        """Why the camera ended by itself; empty while it goes on, and at a regular end."""
        return self._failure

    def _frame(self, index: int, shot: Shot) -> Frame | None:
        """Return an undistorted frame with depth aligned to color; None, with the reason noted, if unusable."""
        try:
            color, raw = self._undistort.color(shot.color), shot.depth
            if self._register is None:
                raw = self._undistort.depth(raw)
            depth_m = depth_in_metres(raw, self.depth_units_per_metre, f"of {self.name}")
            if self._register is not None:
                depth_m = self._register(depth_m, f"of {self.name}")
            return Frame(index, shot.timestamp_s, color, depth_m, shot.T_world_camera)
        except (FrameError, ValueError) as error:
            self._unusable.append(str(error))
            return None

    def _tell(self) -> None:
        """Convert problems to warnings, the most serious one last."""
        if self._unusable:
            count = len(self._unusable)
            self.warnings.append(f"{count} frames of {self.name} could not be used; the first: {self._unusable[0]}")
        if self._failure:
            self.warnings.append(self._failure)

    def _capture(self) -> None:
        """Move frames from the driver into the queue until the end."""
        try:
            last_s = time.monotonic()
            while not self._closing.is_set():
                shot = self._driver.take(POLL_S)
                if shot is not None:
                    self.queue.put(shot)
                    last_s = time.monotonic()
                elif time.monotonic() - last_s > self._silence_s:
                    self._failure = f"{self.name}: gave no frame for {self._silence_s:g} s"
                    return
        except StreamEndedError:
            return
        except CuboidError as error:
            self._failure = str(error)
        except Exception as error:  # vendors' libraries raise all kinds of errors when a camera is unplugged
            self._failure = f"{self.name}: failed: {type(error).__name__}: {error}"
        finally:
            self.queue.end()


def open_camera(camera: str, *, record: PathLike | None = None, form: str = "plain") -> LiveCamera:
    """Open a live camera.

    Parameters
    ----------
    camera : str
        ``NAME`` or ``NAME:OPTION=VALUE,...``: "realsense", "realsense:serial=831612070538,size=848x480". A first
        value without a name is that of `DEVICE_OPTIONS`, as in "realsense:831612070538".
    record : path, optional
        Folder in which the frames are recorded.
    form : {"plain", "mcap"}
        Format of the recorded frames.

    Returns
    -------
    LiveCamera

    Raises
    ------
    InputError
        There is no such camera, or it cannot be opened.
    OutputError
        `record` exists.
    MissingExtraError
        Its driver needs a package that is not installed.
    """
    return camera_from(camera, lambda driver: LiveCamera(driver, record=record, form=form))


def camera_from(camera: str, make: Callable[[Driver], LiveCamera]) -> LiveCamera:
    """Open the driver that ``NAME:OPTION=VALUE,...`` names, and return the camera that is made of it."""
    name, _, rest = camera.partition(":")
    opener = CAMERAS.get(name)
    driver = opener(_options(name, rest))
    try:
        return make(driver)
    except BaseException:
        driver.close()
        raise


def _options(name: str, text: str) -> Mapping[str, str]:
    options: dict[str, str] = {}
    for number, item in enumerate(filter(None, text.split(","))):
        key, equals, value = item.partition("=")
        if number == 0 and not equals:
            key, equals, value = DEVICE_OPTIONS.get(name, "serial"), "=", item
        if not (key and equals and value) or key in options:
            raise InputError(f"--camera {name}: expected OPTION=VALUE,... each once, got '{text}'")
        options[key] = value
    return options
