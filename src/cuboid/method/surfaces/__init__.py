"""Supporting planes, and the segments of a frame that stand on them (steps 7 and 8 of `docs/method.md`)."""
