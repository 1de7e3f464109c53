"""Fit the probability that an object of the map is one whole thing, over many places, and check it on places left out.

python benchmarks/fit_objectness.py --work DIR [--data DATA] [--real DIR --real-truth DIR] [--seeds N ...] [--jobs N]
    [--only NAME ...] [--near FILE] [--write]

Tracks each place of `places.py`, as a whole and from few views: 1, 2, 5 and 20 frames that end at a frame with truth
(`VIEWS`), each with a new tracker. In the frames with truth, each object of the map that the frame shows is a case: its
quantities (`cuboid.method.objects.objectness`), and whether it is right: its rectangle, or its box, has a partner in
the truth. The coefficients of a logistic model are fitted to all cases; every place and number of views has the same
weight whatever its length, and each quantity can only count in the direction that its meaning gives it (`SIGNS`).

Prints the coefficients, and for cases of kinds of places that were left out of the fit: the fraction of right ones in
five bins of the probability, for all cases and by the number of views, and the threshold with the highest mean F1 over
places. `--write` replaces the coefficients in the source. Tracking depends on the coefficients: fit twice or three
times, until they stay. After a new quantity was added to `Quantities` and `SIGNS`, this is the whole refit:

    python benchmarks/fit_objectness.py --work DIR --data DATA --real REAL --real-truth TRUTH --write
"""

from __future__ import annotations

import argparse
import contextlib
import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import msgspec
import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from cuboid import Tracker, open_recording
from cuboid.ground.core.errors import CuboidError, FrameError
from cuboid.ground.core.threads import limit_threads
from cuboid.ground.geometry.overlap import pack
from cuboid.inputs.readers import Recording
from cuboid.lab.evaluation.keyframes import Keyframe, is_keyframes, read_keyframes
from cuboid.lab.evaluation.rectangles import Outcome, judge_frame
from cuboid.lab.evaluation.scope import Scope
from cuboid.lab.evaluation.truth import Truth, read_truth
from cuboid.method.objects import objectness
from cuboid.method.objects.objectness import Coefficients, Quantities, quantities_of
from cuboid.runs.pipeline.run import track_recording
from cuboid.runs.tracking.posed_tracker import PosedTracker
from place_list import Folders, Part, Place, made_places, named, real_places, render

# Whether the probability rises (1) or falls (-1) with a quantity.
SIGNS = Quantities(1, 1, 1, -1, 1, 1, 1, 1, 1, -1, -1, 1, 1, 1, 1, -1)
# Strength of the penalty on the squared weights of the standardized quantities, in cases: it matters where few cases
# tell quantities apart. With `--near`, the second one, on differences from weights that are not 0 there.
PENALTY_CASES, NEAR_CASES = 10.0, 1000.0
# Frames between two judged ones of a recording with 3D truth.
EVERY = 10
# Numbers of views of short runs, and of judged frames of a recording at which they end. Views are this many frames
# apart, a third of a second at 30 Hz: a frame then has full weight.
VIEWS, ENDS, VIEW_STEP = (1, 2, 5, 20), 6, 10
# Number of views of a whole recording.
WHOLE = 0
# IoU of 3D boxes from which a case is right, and below which it is wrong; between them it counts neither way.
RIGHT_IOU, WRONG_IOU = 0.5, 0.3
BINS = 5
THRESHOLDS = np.arange(0.1, 0.9, 0.05)


@dataclass(frozen=True, slots=True)
class Cases:
    """The cases of one place from one number of views.

    Attributes
    ----------
    place, kind : str
    views : int
        `WHOLE` for the whole recordings.
    quantities : (N, Q) float64
    right : (N,) bool
    things : int
        Number of things to be found in the judged frames.
    """

    place: str
    kind: str
    views: int
    quantities: npt.NDArray[np.float64]
    right: npt.NDArray[np.bool_]
    things: int


class Judge:
    """Judges the objects of the map in the frames of one recording.

    Parameters
    ----------
    part : Part
    iou : float
        IoU of rectangles from which a case is right.
    """

    def __init__(self, part: Part, iou: float) -> None:
        self._iou = iou
        self._drawn: dict[int, list[Keyframe]] = {}
        self._truth: Truth | None = None
        for path in part.truths:
            if is_keyframes(path):
                for keyframe in read_keyframes(path).frames:
                    self._drawn.setdefault(keyframe.frame, []).append(keyframe)
        if not self._drawn:
            self._truth = read_truth(part.truths[0])
        self.cases: list[tuple[Quantities, bool]] = []
        self.things = 0

    def is_judged(self, frame: int) -> bool:
        """Return whether a frame is judged."""
        return frame in self._drawn or (self._truth is not None and frame % EVERY == EVERY - 1)

    def judge(self, tracker: PosedTracker, seen: Any, visible: Sequence[tuple[Any, Any]]) -> None:
        """Judge the objects that a frame shows, `visible` with their visibility."""
        shown = [(entry, view) for entry, view in visible if len(entry.points)]
        quantities = [quantities_of(entry) for entry, _ in shown]
        for keyframe in self._drawn.get(seen.frame, ()):
            roll = tracker._roll
            rects = np.array([view.rect_xyxy for _, view in shown]).reshape(-1, 4)
            judged = judge_frame(keyframe, roll._rectangles(rects, roll.camera, -roll.turns % 4), self._iou)
            self.things += int(judged.counts.sum())
            for one, outcome in zip(quantities, judged.outcomes, strict=True):
                if outcome in (Outcome.TRUE, Outcome.FALSE):
                    self.cases.append((one, outcome is Outcome.TRUE))
        if self._truth is not None and seen.frame % EVERY == EVERY - 1 and shown:
            scope = Scope(self._truth, np.array([seen.frame]))
            boxes = scope.boxes(pack([tracker.in_world(entry.box) for entry, _ in shown]), seen.frame)
            best = boxes.iou.max(1, initial=0.0)
            is_shown = scope.shown is None or scope.shown[0] > 0.3
            self.things += int(np.count_nonzero(is_shown))
            for one, iou, left_out in zip(quantities, best, boxes.left_out, strict=True):
                if not left_out and not WRONG_IOU <= iou < RIGHT_IOU:
                    self.cases.append((one, bool(iou >= RIGHT_IOU)))


def cases_of(place: Place) -> list[Cases]:
    """Track the recordings of a place, as a whole and from few views, and return its cases."""
    limit_threads(1)
    found = []
    for views in (WHOLE, *VIEWS):
        judges = [judge for part in place.parts for judge in _judged(part, place.iou, views)]
        cases = [case for judge in judges for case in judge.cases]
        quantities = np.array([one for one, _ in cases]).reshape(-1, len(Quantities._fields))
        right = np.array([is_right for _, is_right in cases], bool)
        found.append(Cases(place.name, place.kind, views, quantities, right, sum(judge.things for judge in judges)))
    return found


def _judged(part: Part, iou: float, views: int) -> list[Judge]:
    """Track a recording, from a number of views up to each of some judged frames, or as a whole; return the judges."""
    if views == WHOLE:
        judge = Judge(part, iou)
        with tempfile.TemporaryDirectory() as folder, patch.object(PosedTracker, "_visible", _judging(judge)):
            track_recording(open_recording(part.recording), Path(folder) / "out")
        return [judge]
    recording = open_recording(part.recording)
    rule = Judge(part, iou)
    judged = [k for k in range(views - 1, len(recording)) if rule.is_judged(k)]
    ends = [judged[k] for k in np.unique(np.linspace(0, len(judged) - 1, ENDS).astype(int))] if judged else []
    return [_judged_at(Judge(part, iou), recording, end, views) for end in ends]


def _judged_at(judge: Judge, recording: Recording, end: int, views: int) -> Judge:
    """Judge frame `end`, of which a new tracker gets so many views, that frame last; return the judge."""
    step = min(VIEW_STEP, end // max(1, views - 1))
    tracker = Tracker(recording.intrinsics)
    for k in range(views - 1, 0, -1):
        _track(tracker, recording, end - k * step)
    with patch.object(PosedTracker, "_visible", _judging(judge)):
        _track(tracker, recording, end)
    return judge


def _track(tracker: Tracker, recording: Recording, frame: int) -> None:
    """Track a frame, unless it cannot be used."""
    with contextlib.suppress(FrameError):
        tracker.update(recording.read(frame))


def _judging(judge: Judge) -> Callable[..., Any]:
    """Return `PosedTracker._visible` with a judge of its result."""
    original = PosedTracker._visible

    def visible(self: PosedTracker, seen: Any, *rest: Any) -> Any:
        shown = original(self, seen, *rest)
        judge.judge(self, seen, shown)
        return shown

    return visible


def fit(cases: Sequence[Cases], near: Coefficients | None = None) -> Coefficients:
    """Fit the model by maximum likelihood with a small penalty on the weights, or a large one on differences."""
    x, right = np.concatenate([one.quantities for one in cases]), np.concatenate([one.right for one in cases])
    weight = np.concatenate([np.full(len(one.right), len(one.right) ** -0.5) for one in cases if len(one.right)])
    weight *= len(weight) / weight.sum()
    mean, scale = np.average(x, 0, weight), x.std(0) + 1e-9
    z, sign = (x - mean) / scale, np.where(right, 1.0, -1.0)
    known = np.array([0.0 if near is None else near.weights.get(name, 0.0) for name in Quantities._fields])
    center, penalty = known * scale, np.where(known != 0.0, NEAR_CASES, PENALTY_CASES)

    def loss(b: npt.NDArray[np.float64]) -> tuple[float, npt.NDArray[np.float64]]:
        odds = sign * (b[0] + z @ b[1:])
        slope = -weight * sign / (1.0 + np.exp(odds))
        off = penalty * (b[1:] - center)
        value = weight @ np.logaddexp(0.0, -odds) + 0.5 * off @ (b[1:] - center)
        return float(value), np.concatenate([[slope.sum()], slope @ z + off])

    bounds = [(None, None), *((0.0, None) if sign > 0 else (None, 0.0) for sign in SIGNS)]
    b = minimize(loss, np.concatenate([[0.0], center]), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = b[1:] / scale
    named_weights = dict(zip(Quantities._fields, weights.round(4).tolist(), strict=True))
    places = len({one.place for one in cases})
    return Coefficients(round(float(b[0] - weights @ mean), 4), named_weights, places, len(right))


def probabilities(model: Coefficients, quantities: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the probability of each case."""
    weights = np.array([model.weights[name] for name in Quantities._fields])
    return np.asarray(1.0 / (1.0 + np.exp(-(model.intercept + quantities @ weights))))


def report(cases: Sequence[Cases], near: Coefficients | None) -> None:
    """Print how well the model predicts cases of kinds of places that it was not fitted to."""
    kinds = sorted({one.kind for one in cases})
    models = {kind: fit([one for one in cases if one.kind != kind], near) for kind in kinds}
    p = [probabilities(models[one.kind], one.quantities) for one in cases]
    for views in (None, WHOLE, *VIEWS):
        chosen = [k for k, one in enumerate(cases) if views in (None, one.views)]
        if chosen:
            name = {None: "all cases", WHOLE: "whole recordings"}.get(views, f"{views} views")
            _report_bins(name, np.concatenate([p[k] for k in chosen]), np.concatenate([cases[k].right for k in chosen]))
    f1 = np.array([[_f1(one, q >= t) for t in THRESHOLDS] for one, q in zip(cases, p, strict=True)])
    best = int(f1.mean(0).argmax())
    print(f"\nhighest mean F1 over places: {f1.mean(0)[best]:.3f} at {THRESHOLDS[best]:.2f}")
    print("by threshold:", " ".join(f"{t:.2f}:{value:.3f}" for t, value in zip(THRESHOLDS, f1.mean(0), strict=True)))
    for one, q, row in zip(cases, p, f1, strict=True):
        at = q >= THRESHOLDS[best]
        found, precision = int(one.right[at].sum()), one.right[at].mean() if at.any() else 0.0
        recall, views = found / max(1, one.things), one.views or "all"
        print(
            f"{one.place:28s} {one.kind:9s} views {views:>3} cases {len(q):5d}  "
            f"R {recall:.3f}  P {precision:.3f}  F1 {row[best]:.3f}"
        )


def _report_bins(name: str, p: npt.NDArray[np.float64], right: npt.NDArray[np.bool_]) -> None:
    """Print the fraction of right cases (N,) in bins of the probability (N,), and the calibration error."""
    print(f"\n{name}: probability  cases  mean  right")
    error = 0.0
    for low in np.arange(BINS) / BINS:
        inside = (p >= low) & (p < low + 1.0 / BINS)
        if inside.any():
            said, true = p[inside].mean(), right[inside].mean()
            error += inside.mean() * abs(said - true)
            print(f"{low:.1f}-{low + 1.0 / BINS:.1f}    {inside.sum():6d}  {said:.2f}  {true:.2f}")
    print(f"expected calibration error {error:.3f}")


def _f1(cases: Cases, chosen: npt.NDArray[np.bool_]) -> float:
    found = int(cases.right[chosen].sum())
    return 2.0 * found / max(1, int(chosen.sum()) + cases.things)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="keeps made recordings")
    parser.add_argument("--data", type=Path, default=None, metavar="DATA", help="real recordings with their truth")
    parser.add_argument("--real", type=Path, default=None, metavar="DIR", help="further real recordings")
    parser.add_argument("--real-truth", type=Path, default=None, metavar="DIR", help="rectangles of these recordings")
    parser.add_argument("--seeds", nargs="*", type=int, default=[1, 2], metavar="N", help="of made places")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these places or kinds of places")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N", help="processes")
    near = "coefficients near which to stay: for a fit to few of the places to which they were fitted"
    parser.add_argument("--near", type=Path, default=None, metavar="FILE", help=near)
    parser.add_argument("--write", action="store_true", help="replace the coefficients in the source")
    parser.add_argument(
        "--cases", type=Path, default=None, metavar="FILE", help="keep the cases, or read them if there"
    )
    args = parser.parse_args()
    try:
        cases = _collected(args)
    except CuboidError as error:
        print(f"fit_objectness: {error}", file=sys.stderr)
        return 2
    near = None if args.near is None else msgspec.json.decode(args.near.read_bytes(), type=Coefficients)
    report(cases, near)
    model = fit(cases, near)
    document = msgspec.json.format(msgspec.json.encode(model), indent=2) + b"\n"
    print(document.decode())
    if args.write:
        Path(objectness.__file__).with_name("objectness.json").write_bytes(document)
    return 0


def _collected(args: argparse.Namespace) -> list[Cases]:
    if args.cases is not None and args.cases.is_file():
        kept: list[Cases] = pickle.loads(args.cases.read_bytes())
        return kept
    folders = Folders(args.data, args.real, args.real_truth, args.work)
    real, absent = real_places(folders, every_still=3)
    if absent:
        print(f"absent: {', '.join(absent)}", file=sys.stderr)
    places = list(named([*real, *made_places(args.seeds, args.work)], args.only))
    with ThreadPoolExecutor(args.jobs) as threads:
        for reason in filter(None, threads.map(render, [part for place in places for part in place.parts])):
            print(reason, file=sys.stderr)
    places = [place for place in places if all(part.recording.exists() for part in place.parts)]
    with ProcessPoolExecutor(args.jobs) as pool:
        cases = []
        for of_place in pool.map(cases_of, places):
            right = np.concatenate([one.right for one in of_place])
            print(f"{of_place[0].place}: {len(right)} cases, {right.sum()} right", file=sys.stderr, flush=True)
            cases += of_place
    cases = [one for one in cases if len(one.right)]
    if args.cases is not None:
        args.cases.write_bytes(pickle.dumps(cases))
    return cases


if __name__ == "__main__":
    sys.exit(main())
