"""DDS for a ROS 2 camera: the images that are published, and readers of topics."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from cuboid.cameras.ros2_messages import WIRE_NAMES, CameraInfo
from cuboid.core.errors import InputError

PREFIX = "rt"  # of topics of ROS
TICK_S = 0.05


class TopicReader:
    """The messages of a topic, as they come; the newest few are kept."""

    def __init__(self, participant: Any, topic: str, kind: Any, kept: int) -> None:
        # best effort and volatile are met by every publisher
        qos = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(kept))
        self._reader: Any = DataReader(participant, Topic(participant, PREFIX + topic, kind), qos=qos)

    def take(self) -> Any:
        """Return the oldest message that is there, as rosbags has it; None where there is none."""
        for sample in self._reader.take(N=1):
            message = getattr(sample, "message", None)  # the word that a publisher has gone has none
            if message is not None:
                return message
        return None


class Network:
    """A participant of a DDS domain.

    Parameters
    ----------
    domain : int
        ROS_DOMAIN_ID.

    Raises
    ------
    InputError
        There is no such domain, or no network.
    """

    def __init__(self, domain: int) -> None:
        try:
            self._participant: Any = DomainParticipant(domain)
        except DDSException as error:
            raise InputError(f"DDS domain {domain} cannot be joined: {error}") from None
        self._publications: Any = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._images: dict[str, str] = {}

    def images(self, wait_s: float, enough: Callable[[Mapping[str, str]], bool]) -> dict[str, str]:
        """Return the topics of images and the names of their types, as soon as they are enough or the time is over."""
        until_s = time.monotonic() + wait_s
        while True:
            for found in self._publications.take(N=64):
                topic, kind = getattr(found, "topic_name", ""), getattr(found, "type_name", "")
                if topic.startswith(f"{PREFIX}/") and kind in WIRE_NAMES:
                    self._images[topic.removeprefix(PREFIX)] = kind
            if enough(self._images) or time.monotonic() > until_s:
                return self._images
            time.sleep(TICK_S)

    def reader(self, topic: str, kind: str, kept: int) -> TopicReader:
        """Return a reader of images."""
        return TopicReader(self._participant, topic, WIRE_NAMES[kind], kept)

    def infos(self, topic: str) -> TopicReader:
        """Return a reader of CameraInfo."""
        return TopicReader(self._participant, topic, CameraInfo, 1)

    def close(self) -> None:
        """Leave the domain: what was made in it ends with the participant."""
        self._publications = self._participant = None
