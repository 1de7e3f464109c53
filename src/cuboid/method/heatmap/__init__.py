"""Stage 4: the heat of a frame's pixels, and the global heatmap in a hashed voxel map."""
