"""How messages of ROS 2 leave and arrive: by DDS without ROS, by rclpy within ROS, by a WebSocket to Foxglove.

Each carries the same bytes (`cuboid.formats.ros_messages` makes them), so that all that stands above is one code.
"""
