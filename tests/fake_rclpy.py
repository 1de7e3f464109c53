"""A stand-in for rclpy with the names that Cuboid uses of it: nodes of one process that hear each other."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from cuboid.ground.formats.ros_messages import RosMessages, request_of, response_of


class FakeRos:
    """The network: subscriptions by topic, services by name, and the types of messages."""

    def __init__(self) -> None:
        self.messages = RosMessages("the tests", "ros2")
        self.subscriptions: dict[str, list[tuple[Callable[[Any], None], Any]]] = {}
        self.published: dict[str, str] = {}
        self.services: dict[str, tuple[Any, Callable[[Any, Any], Any]]] = {}
        self.nodes: list[FakeNode] = []
        self.running = False
        self.types: dict[str, Any] = {}

    def type_of(self, kind: str) -> Any:
        """Return the class of a message, as get_message gives it."""
        if kind not in self.types:
            fields = dict(self.messages.store.fielddefs[kind][1])
            fields.pop("structure_needs_at_least_one_member", None)  # a class of rclpy has no such field

            def begin(self_: Any) -> None:
                for name, (what, of) in fields.items():
                    setattr(self_, name, self.type_of(of)() if what == 2 else None)

            names = dict.fromkeys(fields, "")
            self.types[kind] = type(
                kind.rsplit("/", 1)[1],
                (),
                {"__init__": begin, "kind": kind, "get_fields_and_field_types": classmethod(lambda cls: names)},
            )
        return self.types[kind]

    def serialize(self, message: Any) -> bytes:
        """Do as rclpy.serialization.serialize_message."""
        return self.messages.encode(self._plain(message))

    def deserialize(self, data: bytes, kind: Any) -> Any:
        """Do as rclpy.serialization.deserialize_message."""
        return self._wrapped(self.messages.decode(data, kind.kind))

    def _plain(self, message: Any) -> Any:
        fields = {}
        for name, (what, _) in self.messages.store.fielddefs[message.kind][1]:
            value = getattr(message, name)
            fields[name] = self._plain(value) if what == 2 else value
        return self.messages.store.types[message.kind](**fields)

    def _wrapped(self, message: Any) -> Any:
        made = self.type_of(message.__msgtype__)()
        for name, (what, _) in self.messages.store.fielddefs[message.__msgtype__][1]:
            value = getattr(message, name)
            setattr(made, name, self._wrapped(value) if what == 2 else value)
        return made

    def call(self, service: str, **fields: Any) -> Any:
        """Call a service as a client in another thread of the executor would."""
        kind, callback = self.services[service]
        request = kind.Request()
        for name, value in fields.items():
            setattr(request, name, value)
        return callback(request, kind.Response())


class FakeNode:
    """A node."""

    def __init__(self, ros: FakeRos, name: str) -> None:
        self.ros, self.name, self.destroyed = ros, name, False
        self.parameters: dict[str, Any] = {}
        self.checks: list[Callable[[Any], Any]] = []

    def create_publisher(self, kind: Any, topic: str, qos_profile: Any) -> Any:
        self.ros.published[topic] = kind.kind

        def publish(data: bytes) -> None:
            assert isinstance(data, bytes)
            for callback, _ in self.ros.subscriptions.get(topic, []):
                callback(data)

        count = lambda: len(self.ros.subscriptions.get(topic, []))  # noqa: E731
        return SimpleNamespace(publish=publish, get_subscription_count=count, qos=qos_profile)

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[[Any], None], qos_profile: Any, *, raw: bool = False
    ) -> None:
        assert raw
        self.ros.subscriptions.setdefault(topic, []).append((callback, qos_profile))

    def create_service(self, kind: Any, name: str, callback: Any, *, callback_group: Any) -> None:
        self.ros.services[name] = kind, callback

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return [(topic, [kind]) for topic, kind in self.ros.published.items()]

    def declare_parameter(self, name: str, value: Any) -> Any:
        return SimpleNamespace(name=name, value=self.parameters.setdefault(name, value))

    def add_on_set_parameters_callback(self, callback: Callable[[Any], Any]) -> None:
        self.checks.append(callback)

    def set_parameter(self, name: str, value: Any) -> Any:
        """Do as `ros2 param set`."""
        (check,) = self.checks
        result = check([SimpleNamespace(name=name, value=value)])
        if result.successful:
            self.parameters[name] = value
        return result

    def destroy_node(self) -> None:
        self.destroyed = True


class FakeExecutor:
    """Runs nothing: callbacks come from whoever publishes or calls."""

    def __init__(self, *, num_threads: int) -> None:
        self._ended = threading.Event()

    def add_node(self, node: FakeNode) -> None:
        """Nothing to do."""

    def spin(self) -> None:
        self._ended.wait()

    def shutdown(self) -> None:
        self._ended.set()


def install(monkeypatch: pytest.MonkeyPatch) -> FakeRos:
    """Put the stand-in where imports find it."""
    ros = FakeRos()

    def init(*, args: Any = None, signal_handler_options: Any = None) -> None:
        ros.running = True

    def end() -> None:
        ros.running = False

    def create_node(name: str) -> FakeNode:
        ros.nodes.append(FakeNode(ros, name))
        return ros.nodes[-1]

    def get_service(kind: str) -> Any:
        return SimpleNamespace(Request=ros.type_of(request_of(kind)), Response=ros.type_of(response_of(kind)))

    def enum(*names: str) -> Any:
        return SimpleNamespace(**{name: name for name in names})

    def parameters_result(successful: bool, reason: str = "") -> Any:
        return SimpleNamespace(successful=successful, reason=reason)

    modules = {
        "rclpy": {"ok": lambda: ros.running, "init": init, "try_shutdown": end, "create_node": create_node},
        "rclpy.qos": {
            "QoSProfile": lambda **fields: SimpleNamespace(**fields),
            "ReliabilityPolicy": enum("BEST_EFFORT", "RELIABLE"),
            "DurabilityPolicy": enum("VOLATILE", "TRANSIENT_LOCAL"),
            "HistoryPolicy": enum("KEEP_LAST"),
        },
        "rclpy.serialization": {"serialize_message": ros.serialize, "deserialize_message": ros.deserialize},
        "rclpy.callback_groups": {"ReentrantCallbackGroup": object},
        "rclpy.executors": {"MultiThreadedExecutor": FakeExecutor},
        "rclpy.signals": {"SignalHandlerOptions": enum("NO")},
        "rosidl_runtime_py": {},
        "rosidl_runtime_py.utilities": {"get_message": ros.type_of, "get_service": get_service},
        "rcl_interfaces": {},
        "rcl_interfaces.msg": {"SetParametersResult": parameters_result},
    }
    for name, contents in modules.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    return ros
