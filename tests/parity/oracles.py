"""What motmetrics and trackeval say of sequences of IoU matrices; runs in an environment of its own.

Reads a JSON list of sequences from standard input, a sequence being a list of frames
{"truth": [...], "found": [...], "iou": [[...], ...]}, and prints a JSON list of what the two packages say.
"""

from __future__ import annotations

import json
import sys

import motmetrics
import numpy as np
from trackeval.metrics import HOTA

THRESHOLDS = (0.25, 0.5)
NAMES = {
    "idf1": "idf1",
    "id_precision": "idp",
    "id_recall": "idr",
    "mota": "mota",
    "switches": "num_switches",
    "fragmentations": "num_fragmentations",
    "misses": "num_misses",
    "false_positives": "num_false_positives",
}


def clear(frames, threshold):
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for frame in frames:
        iou = np.array(frame["iou"], float).reshape(len(frame["truth"]), len(frame["found"]))
        distance = np.where(iou >= threshold, 1.0 - iou, np.nan)
        accumulator.update(frame["truth"], frame["found"], distance)
    summary = motmetrics.metrics.create().compute(accumulator, metrics=list(NAMES.values()), name="case")
    return {ours: float(summary[theirs]["case"]) for ours, theirs in NAMES.items()}


def hota(frames):
    data = {
        "gt_ids": [np.array(frame["truth"], int) for frame in frames],
        "tracker_ids": [np.array(frame["found"], int) for frame in frames],
        "similarity_scores": [
            np.array(frame["iou"], float).reshape(len(frame["truth"]), len(frame["found"])) for frame in frames
        ],
    }
    for ids, number, total in (
        ("gt_ids", "num_gt_ids", "num_gt_dets"),
        ("tracker_ids", "num_tracker_ids", "num_tracker_dets"),
    ):
        data[number] = 1 + max((int(row.max()) for row in data[ids] if len(row)), default=-1)
        data[total] = sum(map(len, data[ids]))
    found = HOTA().eval_sequence(data)
    names = {
        "hota": "HOTA",
        "det_a": "DetA",
        "det_re": "DetRe",
        "det_pr": "DetPr",
        "ass_a": "AssA",
        "ass_re": "AssRe",
        "ass_pr": "AssPr",
        "loc_a": "LocA",
    }
    return {
        "per_alpha": np.asarray(found["HOTA"]).tolist(),
        **{ours: float(np.mean(found[theirs])) for ours, theirs in names.items()},
    }


def main():
    sequences = json.load(sys.stdin)
    answers = [
        {"hota": hota(frames), "clear": [clear(frames, threshold) for threshold in THRESHOLDS]} for frames in sequences
    ]
    sys.stdout.write("\n" + json.dumps(answers) + "\n")  # on a line of its own, after what the packages print


if __name__ == "__main__":
    main()
