"""Matching, labels, and the map of objects (steps 9 and 10 of `docs/method.md`)."""
