"""Answers while the camera runs and afterwards: queries of a place, HTTP, MCP, ROS 2."""
