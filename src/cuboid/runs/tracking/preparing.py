"""The part of a frame's processing that depends neither on its pose nor on the map: a thread can do it ahead."""

from __future__ import annotations

from dataclasses import dataclass, replace

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.working import WorkingImage, filled, phase_of, thin
from cuboid.method.proposals.depth import DepthSegmentation
from cuboid.method.proposals.types import Proposals, ProposalSource
from cuboid.runs.tracking.rolling import Roll, farther_up


@dataclass(frozen=True, slots=True)
class PreparedImages:
    """The images of a frame, prepared for the tracker of posed frames.

    Attributes
    ----------
    turned : Frame
        The frame, rotated by `turns`.
    turns : int
        Number of clockwise quarter turns.
    image : WorkingImage
        The subsampled frame, without mixed pixels.
    solid : WorkingImage
        The same image with its holes filled.
    proposals : Proposals or None
        Proposals of the rotated frame; None if their source gets the frames in order, with the tracker.
    number : int
        Number of frames of the same camera that were prepared before.
    """

    turned: Frame
    turns: int
    image: WorkingImage
    solid: WorkingImage
    proposals: Proposals | None
    number: int = 0


@dataclass(slots=True)
class _Expected:
    """The expected rotation and pixel offset of a camera's next frame; the tracker decides when it processes the frame.

    `turns` is None before the first frame with depth; `first` is the number of frames that the tracker had used before
    the first one that was prepared, less those that it has not used since.
    """

    turns: int | None = None
    prepared: int = 0
    first: int = 0


class Preparer:
    """Prepares the frames of a tracker, at once or ahead of it.

    Two properties of a frame follow from the frames before it: the rotation of its images, and the offset of its
    subsampled pixels. Ahead of the tracker both are expected values, and `fitted` repeats the steps that used a wrong
    one: a frame before it turned out to be unusable.

    Parameters
    ----------
    intrinsics : Intrinsics
        Intrinsics of every frame that does not come with a camera of a rig.
    config : TrackerConfig
    propose : ProposalSource
        Source of 2D proposals. Only the depth segmentation, whose result depends on the frame alone, is used here.
    """

    def __init__(self, intrinsics: Intrinsics, config: TrackerConfig, propose: ProposalSource) -> None:
        self._intrinsics, self._width_px = intrinsics, config.working_width_px
        self._max_depth_m = config.max_depth_m
        self._propose = propose if isinstance(propose, DepthSegmentation) else None
        self._expected: dict[str, _Expected] = {}

    def ahead(self, frame: Frame) -> PreparedImages:
        """Prepare a frame before the tracker has processed the frames before it; one thread calls this, in order."""
        expected = self._expected.setdefault(frame.camera_name, _Expected())
        if expected.turns is None:
            expected.turns = farther_up(frame.depth_m)
        roll = Roll(frame.intrinsics_or(self._intrinsics), expected.turns or 0)
        number, expected.prepared = expected.prepared, expected.prepared + 1
        images = self.now(frame, roll, expected.first + number)
        images.image.depth.cells(self._max_depth_m)  # kept for the stage planes, which needs them in many frames
        return replace(images, number=number)

    def now(self, frame: Frame, roll: Roll, count: int) -> PreparedImages:
        """Prepare a frame, with its rotation and the number of used frames of its camera before it."""
        turned = roll.frame(frame)
        image = thin(turned, roll.camera, self._width_px, count)
        proposals = None if self._propose is None else self._propose(turned, roll.camera)
        return PreparedImages(turned, roll.turns, image, filled(image), proposals)

    def fitted(self, images: PreparedImages | None, frame: Frame, roll: Roll, count: int) -> PreparedImages:
        """Return the images of a frame as `now` prepares them, from images that were prepared ahead, if there are any.

        Parameters
        ----------
        images : PreparedImages or None
        frame : Frame
        roll : Roll
        count : int
            Number of used frames of its camera before it.
        """
        if images is None:
            return self.now(frame, roll, count)
        expected = self._expected[frame.camera_name]
        if images.turns != roll.turns:
            expected.turns = roll.turns
            return self.now(frame, roll, count)
        if images.image.phase == phase_of(images.image.step, count):
            return images
        expected.first = count - images.number
        image = thin(images.turned, roll.camera, self._width_px, count)
        return replace(images, image=image, solid=filled(image))
