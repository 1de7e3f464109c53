"""The method: from a frame to labelled objects with boxes, one package per step, in the order of the data."""
