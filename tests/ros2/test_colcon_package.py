"""The colcon package `ros/cuboid_ros` agrees with the node: manifest, services, topics, options of the launch file."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import runpy
import sys
from argparse import ArgumentParser
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("catkin_pkg", reason="the manifest is parsed by catkin_pkg: pip install '.[dev]'")
pytest.importorskip("foxglove", reason="the layout is compared with foxglove-sdk: pip install '.[foxglove]'")
pytest.importorskip("rosbags", reason="messages are made with rosbags: pip install '.[ros2]'")

import yaml
from catkin_pkg.package import parse_package
from foxglove import layouts

from cuboid.cli.ros2 import add_arguments
from cuboid.ground.formats.ros_messages import OWN, SERVICES, RosMessages
from cuboid.ground.middleware.transport import Qos
from cuboid.results.views.ros_stream import RosStream
from fakes import INTRINSICS

PACKAGE = Path(__file__).resolve().parents[2] / "ros" / "cuboid_ros"
RVIZ_TYPES = {"MarkerArray": "visualization_msgs/msg/MarkerArray", "PointCloud2": "sensor_msgs/msg/PointCloud2"}


class Carrier:
    """Records the topics of a stream."""

    def __init__(self) -> None:
        self.topics: dict[str, tuple[str, Qos]] = {}

    def outlet(self, name: str, kind: str, qos: Qos) -> Any:
        self.topics[name] = kind, qos
        return SimpleNamespace(wanted=lambda: False)


def test_the_manifest_declares_all_packages_of_messages() -> None:
    package = parse_package(str(PACKAGE))
    package.validate()
    assert package.name == "cuboid_ros"
    assert package.licenses == ["Apache-2.0"]
    carrier = Carrier()
    RosStream(RosMessages("the tests", "ros2"), [carrier], INTRINSICS)
    sent = {kind.split("/")[0] for kind, _ in carrier.topics.values()} - {package.name}
    needed = sent | {"rclpy", "launch", "launch_ros", "rviz2"}
    declared = {one.name for one in (*package.exec_depends, *package.build_depends)}
    assert needed <= declared


def test_services_are_built_as_the_node_sends_them() -> None:
    files = {f"cuboid_ros/srv/{file.stem}": file for file in (PACKAGE / "srv").glob("*.srv")}
    assert files.keys() == {kind for kind in SERVICES if kind.startswith("cuboid_ros/")}
    built = (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8")
    for kind, file in files.items():
        request, _, response = re.sub(r"#.*\n", "", file.read_text(encoding="utf-8")).partition("---\n")
        assert (request, response) == SERVICES[kind], kind
        assert f"srv/{file.name}" in built


def test_messages_are_built_as_the_node_sends_them() -> None:
    files = {f"cuboid_ros/msg/{file.stem}": file for file in (PACKAGE / "msg").glob("*.msg")}
    assert files.keys() == OWN.keys()
    built = (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8")
    for kind, file in files.items():
        assert re.sub(r"#.*\n", "", file.read_text(encoding="utf-8")) == OWN[kind]
        assert f"msg/{file.name}" in built


def test_rviz_shows_topics_of_the_node_with_their_types_and_durability() -> None:
    carrier = Carrier()
    RosStream(RosMessages("the tests", "ros2"), [carrier], INTRINSICS)
    rviz = yaml.safe_load((PACKAGE / "rviz" / "cuboid.rviz").read_text(encoding="utf-8"))
    shown = {}
    for display in rviz["Visualization Manager"]["Displays"]:
        name, kind = display.get("Topic", {}).get("Value", ""), display["Class"].rsplit("/", 1)[1]
        if name.startswith("/cuboid/"):
            shown[name] = RVIZ_TYPES[kind]
            latched = display["Topic"]["Durability Policy"] == "Transient Local"
            assert latched == (carrier.topics[name][1] is Qos.LATCHED), name
    assert shown.keys() == {"/cuboid/markers", "/cuboid/map", "/cuboid/cloud"}
    assert shown == {name: carrier.topics[name][0] for name in shown}


# The types of messages that each panel of Foxglove shows, for the settings that name a topic.
FOXGLOVE_TYPES = {
    "3D": {"visualization_msgs/msg/MarkerArray", "sensor_msgs/msg/PointCloud2"},
    "Image": {"visualization_msgs/msg/MarkerArray"},
    "imageTopic": {"sensor_msgs/msg/CompressedImage"},
    "calibrationTopic": {"sensor_msgs/msg/CameraInfo"},
    "DiagnosticStatusPanel": {"diagnostic_msgs/msg/DiagnosticArray"},
    "Table": {"cuboid_ros/msg/ObjectEvent"},
    "RawMessages": {"vision_msgs/msg/Detection3DArray"},
}


# The SDK's descriptions of the settings of these panels.
FOXGLOVE_SETTINGS = {
    "3D": layouts.ThreeDeeConfig,
    "Image": layouts.ImageConfig,
    "Table": layouts.TableConfig,
    "DiagnosticStatusPanel": layouts.DiagnosticsDetailConfig,
    "RawMessages": layouts.RawMessagesConfig,
}


def panels_of(tree: Any) -> list[str]:
    """Return the panels of a layout, from its tree of splits."""
    if isinstance(tree, str):
        return [tree]
    assert tree["direction"] in ("row", "column")
    assert 0 < tree["splitPercentage"] < 100
    return panels_of(tree["first"]) + panels_of(tree["second"])


def test_foxglove_shows_topics_of_the_node_in_panels_for_their_types() -> None:
    carrier = Carrier()
    RosStream(RosMessages("the tests", "ros2"), [carrier], INTRINSICS, pictures=[carrier])
    layout = json.loads((PACKAGE / "foxglove" / "cuboid.json").read_text(encoding="utf-8"))
    assert sorted(panels_of(layout["layout"])) == sorted(layout["configById"])
    shown: dict[str, set[str]] = {}
    for panel, settings in layout["configById"].items():
        kind = panel.split("!")[0]
        known = {one.name.replace("_", "") for one in dataclasses.fields(FOXGLOVE_SETTINGS[kind])}
        assert {name.lower() for name in settings} <= known
        named = dict.fromkeys(settings.get("topics", {}), kind)
        named |= {topic: setting for setting, topic in settings.get("imageMode", {}).items()}
        named |= {settings[key]: kind for key in ("topicPath", "topicToRender") if key in settings}
        for topic, where in named.items():
            assert carrier.topics[topic][0] in FOXGLOVE_TYPES[where], (panel, topic)
            shown.setdefault(kind, set()).add(topic)
    assert shown["3D"] == {"/cuboid/markers", "/cuboid/map", "/cuboid/cloud"}
    assert {topic for topics in shown.values() for topic in topics} == {*carrier.topics} - {"/tf"}


def stand_ins() -> dict[str, ModuleType]:
    """Return modules in the place of `launch` and `launch_ros` that keep the arguments of their classes."""
    modules = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {
            "DeclareLaunchArgument": lambda name, **rest: SimpleNamespace(name=name, **rest),
            "OpaqueFunction": lambda function: SimpleNamespace(function=function),
        },
        "launch_ros": {},
        "launch_ros.actions": {"Node": SimpleNamespace},
        "launch_ros.substitutions": {
            "FindPackageShare": lambda name: SimpleNamespace(perform=lambda context: f"/opt/share/{name}")
        },
    }
    made = {}
    for name, content in modules.items():
        made[name] = ModuleType(name)
        vars(made[name]).update(content)
    return made


def launched(monkeypatch: pytest.MonkeyPatch, **given: str) -> list[Any]:
    """Return the nodes that the launch file starts with some arguments, the others as declared."""
    for name, module in stand_ins().items():
        monkeypatch.setitem(sys.modules, name, module)
    launch = runpy.run_path(str(PACKAGE / "launch" / "cuboid.launch.py"))
    *declared, opaque = launch["generate_launch_description"]()
    settings = {one.name: one.default_value for one in declared}
    assert given.keys() <= settings.keys()
    nodes: list[Any] = opaque.function(SimpleNamespace(launch_configurations=settings | given))
    return nodes


def test_the_launch_file_starts_the_node_with_options_of_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    (node,) = launched(monkeypatch, pose="tf", output="/tmp/found", foxglove="0.0.0.0:8765", use_sim_time="true")
    assert os.access(PACKAGE / "scripts" / node.executable, os.X_OK)
    parser = ArgumentParser(allow_abbrev=False)
    add_arguments(parser)
    args = parser.parse_args(node.arguments)
    assert (args.pose, str(args.output), args.sim_time) == ("tf", "/tmp/found", True)
    assert args.color == ["/camera/color/image_raw"]
    assert args.foxglove == ("0.0.0.0", 8765)


def test_the_launch_file_starts_the_node_for_a_rig(monkeypatch: pytest.MonkeyPatch) -> None:
    color, depth = "/left/color,/right/color", "/left/depth,/right/depth"
    (node,) = launched(monkeypatch, rig="/etc/a,b/rig.json", color=color, depth=depth, pose="tf")
    parser = ArgumentParser(allow_abbrev=False)
    add_arguments(parser)
    args = parser.parse_args(node.arguments)
    assert args.rig == Path("/etc/a,b/rig.json")
    assert (args.color, args.depth) == (["/left/color", "/right/color"], ["/left/depth", "/right/depth"])


def test_the_launch_file_starts_rviz_on_request(monkeypatch: pytest.MonkeyPatch) -> None:
    node, rviz = launched(monkeypatch, rviz="true")
    assert node.package == "cuboid_ros"
    assert rviz.arguments == ["-d", "/opt/share/cuboid_ros/rviz/cuboid.rviz"]
    assert (PACKAGE / "rviz" / "cuboid.rviz").exists()
