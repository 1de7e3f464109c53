"""The heat of a frame's pixels (steps 4 to 6 of `docs/method.md`), and the global heatmap in a hashed voxel map."""
