"""Camera poses from the video alone: dense odometry, keyframes, loop closure, a graph of poses."""
