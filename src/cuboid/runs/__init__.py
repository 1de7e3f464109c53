"""The tracker, the scene that keeps its state over several recordings, and the loops over a recording."""
