"""Stage 7: matching, labels, and the map of objects."""
