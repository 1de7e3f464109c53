"""The node of ROS 2: it receives images, tracks, and publishes the objects."""
