"""The services of the node, and the same commands as text on two topics.

    /cuboid/save      cuboid_ros/srv/Save       write the results: into --output, or into a folder beside it
    /cuboid/reset     std_srvs/srv/Trigger      delete the map and start again
    /cuboid/name      cuboid_ros/srv/Name       give an object a name
    /cuboid/query     cuboid_ros/srv/Query      find objects by label, name or place
    /cuboid/cloud     cuboid_ros/srv/Cloud      return the points of an object, or of the map; publish them as well
    /cuboid/command   std_msgs/String, in       commands in JSON: {"command": "query", "name": "cup", "id": 7}
    /cuboid/answer    std_msgs/String, out      {"id": 7, "success": true, "message": "2 objects", "objects": [...]}

The topics are for programs that cannot call the services: nodes on Fast DDS while this node is on bare DDS, and
programs without the package `cuboid_ros`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from cuboid.ground.core.results import TrackedObject
from cuboid.ground.formats.ros_messages import RosMessages, request_of, response_of
from cuboid.ground.middleware.transport import Qos, Request, Services, Transport
from cuboid.results.files.naming import renamed_object
from cuboid.results.files.objects import object_to_json
from cuboid.results.views.ros_stream import RosStream
from cuboid.services.ros2.commands import Answer, AnyCommand, Cloud, Name, Query, Reset, Save

TEXT = "std_msgs/msg/String"
# Maximum number of waiting commands.
WAITING_COMMANDS = 10
# Type of each service, and the function from its request to a command.
SERVICES: dict[str, tuple[str, Callable[[Any], AnyCommand]]] = {
    "save": ("cuboid_ros/srv/Save", lambda request: Save(folder=request.folder)),
    "reset": ("std_srvs/srv/Trigger", lambda request: Reset()),
    "name": ("cuboid_ros/srv/Name", lambda request: Name(label=request.label, name=request.name)),
    "query": (
        "cuboid_ros/srv/Query",
        lambda request: Query(
            label=request.label,
            name=request.name,
            near=(request.near.x, request.near.y, request.near.z),
            within_m=request.within_m,
        ),
    ),
    "cloud": ("cuboid_ros/srv/Cloud", lambda request: Cloud(label=request.label)),
}


class NodeServices:
    """Executes the service calls and the commands, and sends their answers.

    Parameters
    ----------
    messages : RosMessages
    transport : Transport
        Transport of the two topics, commands and answers.
    carriers : sequence of Services
        Transports of the services.
    stream : RosStream
        Makes the messages of objects and points.
    node : str
        Name of the node; the names of all services and topics begin with it.
    answer : callable
        Executes a command.
    now_ns : callable
        The node's clock.
    """

    def __init__(
        self,
        messages: RosMessages,
        transport: Transport,
        carriers: Sequence[Services],
        stream: RosStream,
        node: str,
        answer: Callable[[AnyCommand], Answer],
        now_ns: Callable[[], int],
    ) -> None:
        self._messages, self._carriers, self._stream, self._node = messages, carriers, stream, node
        self._answer, self._now_ns = answer, now_ns
        self._commands = transport.inlet(f"/{node}/command", TEXT, Qos.RELIABLE, WAITING_COMMANDS, wakes=False)
        self._answers = transport.outlet(f"/{node}/answer", TEXT, Qos.RELIABLE)
        for carrier in carriers:
            for name, (kind, _) in SERVICES.items():
                carrier.serve(f"/{node}/{name}", kind)

    def run(self) -> None:
        """Answer all calls and commands that have arrived."""
        for carrier in self._carriers:
            for request in carrier.requests():
                request.reply(self._replied(request))
        while (data := self._commands.take()) is not None:
            text = self._replied_text(self._messages.decode(data, TEXT).data)
            self._answers.send(self._messages.encode(self._messages.make("std_msgs/String", data=text)), self._now_ns())

    def _replied(self, request: Request) -> bytes:
        """Return the answer to a call of a service."""
        kind, command_of = SERVICES[request.service.removeprefix(f"/{self._node}/")]
        answer = self._answer(command_of(self._messages.decode(request.data, request_of(kind))))
        fields: dict[str, Any] = {"success": answer.success, "message": answer.message}
        types, now_ns = self._messages.store.types, self._now_ns()
        response = types[response_of(kind)]
        names = {name for name, _ in self._messages.store.fielddefs[response_of(kind)][1]}
        if "objects" in names:
            fields["objects"] = self._stream.detections(answer.objects or (), now_ns)
        if "cloud" in names:
            fields["cloud"] = self._cloud(answer, now_ns)
        return self._messages.encode(response(**fields))

    def _replied_text(self, text: str) -> str:
        """Return the answer to a command, as JSON."""
        try:
            command = msgspec.json.decode(text, type=AnyCommand)
        except msgspec.DecodeError as error:
            return json.dumps({"id": None, "success": False, "message": f"not a command: {error}"})
        answer = self._answer(command)
        shown: dict[str, Any] = {"id": command.id, "success": answer.success, "message": answer.message}
        if answer.objects is not None:
            shown["objects"] = [self._shown(item) for item in answer.objects]
        if answer.parameters is not None:
            shown["parameters"] = answer.parameters
        if answer.cloud is not None:
            self._cloud(answer, self._now_ns())
        return json.dumps(shown)

    def _shown(self, item: TrackedObject) -> dict[str, Any]:
        name = self._stream.names.get(item.label)
        return object_to_json(renamed_object(item, name) if name else item)

    def _cloud(self, answer: Answer, now_ns: int) -> Any:
        """Return the points of an answer as a message, and publish this message as well."""
        if answer.cloud is None:
            return self._stream.empty_cloud(now_ns)
        cloud = self._stream.cloud(answer.cloud.xyz, answer.cloud.rgb, now_ns)
        self._stream.send_cloud(cloud, now_ns)
        return cloud
