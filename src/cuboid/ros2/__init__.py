"""The node of ROS 2: frames from its topics to the tracker, what was found to its topics."""
