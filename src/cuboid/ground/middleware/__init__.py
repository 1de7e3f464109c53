"""Transports of ROS 2 messages: DDS without ROS, rclpy within ROS, and a WebSocket to Foxglove.

All transports send the same bytes, which `cuboid.ground.formats.ros_messages` encodes, so that the node needs no code
for a particular transport.
"""
