"""The node, and RViz where it is wanted: `ros2 launch cuboid_ros cuboid.launch.py pose:=tf rviz:=true`."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

# Argument, default, meaning; empty ones are left out.
ARGUMENTS = (
    ("color", "/camera/color/image_raw", "topic of color images; of a rig, those of all cameras, with commas between"),
    ("depth", "/camera/aligned_depth_to_color/image_raw", "topic of depth, aligned to color; of a rig, as for color"),
    ("rig", "", "rig.json of several cameras, in the order of the color topics"),
    ("info", "", "topic of color's CameraInfo, if it is not camera_info beside color"),
    ("pose", "estimated", "tf, estimated, or a topic of poses"),
    ("world", "", "frame of the world, if it is not the root of tf or map"),
    ("output", "", "folder of the results"),
    ("foxglove", "", "HOST:PORT at which Foxglove is served, too"),
    ("detector", "", "ONNX file or name of a detector, which names the objects"),
)
TOPICS = ("color", "depth")
FLAGS = (("use_sim_time", "--sim-time"),)


def actions(context):
    """Return the node, and RViz where it is wanted."""
    given = context.launch_configurations
    words = []
    for name, _, _ in ARGUMENTS:
        # The topics of a rig: an option for each camera.
        values = given[name].split(",") if name in TOPICS else [given[name]]
        words += [f"--{name}={value}" for value in values if value]
    words += [option for name, option in FLAGS if given[name] == "true"]
    parameters = [{"use_sim_time": given["use_sim_time"] == "true", "object_frames": given["object_frames"] == "true"}]
    node = Node(
        package="cuboid_ros",
        executable="cuboid_node",
        name="cuboid",
        output="screen",
        arguments=words,
        parameters=parameters,
    )
    if given["rviz"] != "true":
        return [node]
    shown = Path(FindPackageShare("cuboid_ros").perform(context)) / "rviz" / "cuboid.rviz"
    return [node, Node(package="rviz2", executable="rviz2", arguments=["-d", str(shown)], parameters=parameters[:1])]


def generate_launch_description():
    """Return the arguments and what they start."""
    switches = (
        ("use_sim_time", "false", "take the time from /clock"),
        ("object_frames", "false", "one frame of tf an object"),
        ("rviz", "false", "start RViz, too"),
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=meaning)
        for name, default, meaning in (*ARGUMENTS, *switches)
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=actions)])
