"""Stage 5: supporting planes, and the segments of a frame that stand on them."""
