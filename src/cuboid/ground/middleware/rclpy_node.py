"""ROS 2 within ROS: a node of rclpy, which is part of a sourced ROS environment.

Topics pass bytes (raw subscriptions, publishers of serialized messages), so that rclpy does not decode images into
Python objects. The tests use a fake with the names of rclpy; the node was not tested within ROS.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import TimeoutError as AnswerTimeoutError
from importlib import import_module
from typing import Any

from cuboid.ground.core.errors import InputError, MissingExtraError
from cuboid.ground.formats.ros_messages import RosMessages, request_of, response_of
from cuboid.ground.middleware.transport import ANSWER_S, HISTORY_DEPTH, Inlet, Outlet, PendingCalls, Qos, Request

THREADS = 2  # one receives messages, one waits for the answer to a call


class RclpyTransport:
    """A node of rclpy; implements `Transport`.

    Parameters
    ----------
    node : str
        Name of the node.
    messages : RosMessages

    Raises
    ------
    MissingExtraError
        rclpy, or the package of a message, cannot be imported.
    """

    def __init__(self, node: str, messages: RosMessages) -> None:
        self._rclpy, self._qos, self._find = (
            _ros(name) for name in ("rclpy", "rclpy.qos", "rosidl_runtime_py.utilities")
        )
        self._serialization, groups, executors = (
            _ros(f"rclpy.{name}") for name in ("serialization", "callback_groups", "executors")
        )
        self.name = f"rclpy node {node}"
        self._messages = messages
        if not self._rclpy.ok():
            # Cuboid handles signals: a signal ends the run, and the end of the run shuts rclpy down.
            self._rclpy.init(args=None, signal_handler_options=_ros("rclpy.signals").SignalHandlerOptions.NO)
        self._node: Any = self._rclpy.create_node(node)
        self._group: Any = groups.ReentrantCallbackGroup()
        self._arrived = threading.Condition()
        self._news = False
        self._calls = PendingCalls()
        self._executor: Any = executors.MultiThreadedExecutor(num_threads=THREADS)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, name="cuboid-rclpy", daemon=True)
        self._thread.start()

    def topics(self) -> Mapping[str, str]:
        """Return the topics found so far, with their types."""
        return {topic: kinds[0] for topic, kinds in self._node.get_topic_names_and_types()}

    def outlet(self, topic: str, kind: str, qos: Qos) -> Outlet:
        """Return a topic to send on; see `Outlets.outlet`."""
        return _Publisher(self._node.create_publisher(self._message(kind), topic, self._profile(qos, HISTORY_DEPTH)))

    def inlet(self, topic: str, kind: str, qos: Qos, kept: int, *, wakes: bool = True) -> Inlet:
        """Return a topic to receive from; see `Transport.inlet`."""
        inlet = _Subscription(kept, self._wake if wakes else lambda: None)
        profile = self._profile(qos, kept)
        self._node.create_subscription(self._message(kind), topic, inlet.arrived, profile, raw=True)
        return inlet

    def serve(self, service: str, kind: str) -> None:
        """Offer a service."""
        try:
            found = self._find.get_service(kind)
        except (ImportError, AttributeError, ValueError) as error:
            raise _missing(kind, error) from None

        def answer(request: Any, response: Any) -> Any:
            data = self._encoded(request, request_of(kind))
            try:
                replied = self._messages.decode(self._calls.call(service, data), response_of(kind))
            except AnswerTimeoutError:
                response.success, response.message = False, f"no answer within {ANSWER_S:g} s"
                return response
            return self._filled(response, replied)

        self._node.create_service(found, service, answer, callback_group=self._group)

    def requests(self) -> Iterator[Request]:
        """Iterate over the service calls that have arrived."""
        return self._calls.requests()

    def declare(self, values: Mapping[str, Any], change: Callable[[str, Any], None]) -> None:
        """Offer parameters; `change` receives each new value, and raises InputError if the value is invalid."""
        result = _ros("rcl_interfaces.msg").SetParametersResult

        def changed(parameters: Any) -> Any:
            try:
                for one in parameters:
                    if one.name in values:
                        change(one.name, one.value)
            except InputError as error:
                return result(successful=False, reason=str(error))
            return result(successful=True)

        for name, value in values.items():
            change(name, self._node.declare_parameter(name, value).value)
        self._node.add_on_set_parameters_callback(changed)

    def wait(self, seconds: float) -> None:
        """Wait for a message, at most this many seconds."""
        with self._arrived:
            if not self._news:
                self._arrived.wait(seconds)
            self._news = False

    def close(self) -> None:
        """Shut the node and rclpy down."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._rclpy.try_shutdown()

    def _wake(self) -> None:
        with self._arrived:
            self._news = True
            self._arrived.notify_all()

    def _message(self, kind: str) -> Any:
        try:
            return self._find.get_message(kind)
        except (ImportError, AttributeError, ValueError) as error:
            raise _missing(kind, error) from None

    def _profile(self, qos: Qos, kept: int) -> Any:
        names = self._qos
        reliability, durability = names.ReliabilityPolicy, names.DurabilityPolicy
        return names.QoSProfile(
            history=names.HistoryPolicy.KEEP_LAST,
            depth=1 if qos is Qos.LATCHED else kept,
            reliability=reliability.BEST_EFFORT if qos is Qos.SENSOR else reliability.RELIABLE,
            durability=durability.TRANSIENT_LOCAL if qos is Qos.LATCHED else durability.VOLATILE,
        )

    def _encoded(self, request: Any, kind: str) -> bytes:
        """Return the bytes of a request: rclpy encodes its nested messages, the other fields are copied."""
        fields = {}
        for name in self._messages.store.fielddefs[kind][1]:
            value = getattr(request, name[0], 0)  # an empty request has one placeholder field, which rclpy may lack
            if hasattr(value, "get_fields_and_field_types"):
                value = self._messages.decode(self._serialization.serialize_message(value), name[1][1])
            fields[name[0]] = value
        return self._messages.encode(self._messages.store.types[kind](**fields))

    def _filled(self, response: Any, replied: Any) -> Any:
        """Copy the fields of an answer into the response of rclpy, and return the response."""
        for name, _ in self._messages.store.fielddefs[replied.__msgtype__][1]:
            value = getattr(replied, name)
            if hasattr(value, "__msgtype__"):
                kind = type(getattr(response, name))
                value = self._serialization.deserialize_message(self._messages.encode(value), kind)
            setattr(response, name, value)
        return response


def _ros(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"'--transport rclpy' needs {module}, a part of a sourced ROS 2 ({error}); --transport dds needs no ROS"
        ) from None


def _missing(kind: str, error: Exception) -> MissingExtraError:
    package = kind.partition("/")[0]
    return MissingExtraError(f"'--transport rclpy' needs the ROS package {package} for {kind}: {error}")


class _Publisher:
    """A topic to send on."""

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    def wanted(self) -> bool:
        """Return whether there are subscribers."""
        return bool(self._publisher.get_subscription_count())

    def send(self, data: bytes, time_ns: int) -> None:
        """Send a message."""
        self._publisher.publish(data)


class _Subscription:
    """A topic to receive from."""

    def __init__(self, kept: int, wake: Callable[[], None]) -> None:
        self._messages: deque[bytes] = deque(maxlen=kept)
        self._wake = wake

    def arrived(self, data: bytes) -> None:
        """Store a message; the executor calls this."""
        self._messages.append(bytes(data))
        self._wake()

    def take(self) -> bytes | None:
        """Return the oldest waiting message; None without one."""
        try:
            return self._messages.popleft()
        except IndexError:
            return None
