"""A bag, the node and a listener in three processes: latency from image to detections, drops, growth of memory.

    python benchmarks/ros2_loop.py RECORDING [--seconds 60] [--hertz 30] [--pose tf|estimated] [--queue N] [--json FILE]

RECORDING becomes a bag (`cuboid convert --to mcap`), which `play` sends forwards and backwards in turn, with the times
of now, as a camera would. `listen` notes when the detections of each image arrive. The latency is from the stamp of an
image, made as its color is about to be sent, to the arrival of its detections in the third process. The counts show
where images are lost: on the network, without a partner, without a pose, or in the queue of the node. `processor_s` has
the processor time of each process and of all others on the machine; if together they use all cores, the figures depend
on the others.

`play` and `listen` are programs of their own, which the tests use too.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import Reader

from cuboid.ground.core.limits import FRAMES_WAITING
from cuboid.ground.formats.ros_messages import RosMessages
from cuboid.ground.middleware.dds import DdsTransport
from cuboid.ground.middleware.transport import Qos

DETECTIONS = "vision_msgs/msg/Detection3DArray"
CLOCK, CLOCK_TYPE = "/clock", "rosgraph_msgs/msg/Clock"
TF_TYPE = "tf2_msgs/msg/TFMessage"
STAMP = struct.Struct("<iI")
# CDR: four bytes tell the encoding; a header begins with its stamp. In tf the number of transforms comes first.
STAMP_AT = {True: 8, False: 4}
# The first frames load kernels and caches: figures leave them out.
WARM_UP_S = 5.0


@dataclass(frozen=True)
class Message:
    """A message of a bag."""

    topic: str
    kind: str
    data: bytes

    def at(self, time_ns: int) -> bytes:
        """Return its bytes with another time."""
        data, place = bytearray(self.data), STAMP_AT[self.kind == TF_TYPE]
        STAMP.pack_into(data, place, time_ns // 10**9, time_ns % 10**9)
        return bytes(data)


def frames_of(bag: Path, count: int) -> list[list[Message]]:
    """Return the messages of the first frames of a bag, those of one time together."""
    frames: dict[int, list[Message]] = {}
    with Reader(bag) as reader:
        for connection, time_ns, data in reader.messages():
            if time_ns not in frames and len(frames) == count:
                break
            frames.setdefault(time_ns, []).append(Message(connection.topic, connection.msgtype, bytes(data)))
    return list(frames.values())


def back_and_forth(count: int) -> Iterator[int]:
    """Give 0 .. count - 1 forwards, then backwards, and so on: a camera path without a jump."""
    while True:
        yield from range(count)
        yield from range(count - 2, 0, -1)


def play(args: argparse.Namespace) -> None:
    """Send a bag until its frames have been sent, or the process is ended."""
    messages = RosMessages("play", "ros2")
    transport = DdsTransport(args.domain, messages)
    frames = frames_of(args.bag, args.distinct)
    kinds = {message.topic: message.kind for frame in frames for message in frame}
    outlets = {topic: transport.outlet(topic, kind, Qos.RELIABLE) for topic, kind in kinds.items()}
    clock = transport.outlet(CLOCK, CLOCK_TYPE, Qos.RELIABLE)
    if args.wait:  # for the node to listen
        wanted = next(topic for topic in kinds if "color" in topic and "info" not in topic)
        while not outlets[wanted].wanted():
            # the node asks for the camera before it listens to color
            for message in frames[0]:
                outlets[message.topic].send(message.at(args.first_ns or time.time_ns()), 0)
            time.sleep(1 / args.hertz)
    print("playing", flush=True)
    begun_s, late = time.monotonic(), 0
    for sent, k in zip(range(args.frames), back_and_forth(len(frames)), strict=False):
        due_s = begun_s + sent / args.hertz
        late += time.monotonic() > due_s + 1 / args.hertz
        time.sleep(max(0.0, due_s - time.monotonic()))
        stamp_ns = args.first_ns + round(sent * 1e9 / args.hertz) if args.first_ns else time.time_ns()
        if args.clock:
            now = messages.make("rosgraph_msgs/Clock", clock=messages.header("", stamp_ns).stamp)
            clock.send(messages.encode(now), stamp_ns)
        for message in frames[k]:
            outlets[message.topic].send(message.at(stamp_ns), stamp_ns)
    print(json.dumps({"sent": args.frames, "late": late}), flush=True)
    time.sleep(args.linger)
    transport.close()


def listen(args: argparse.Namespace) -> None:
    """Note each array of detections until SIGTERM, and print what came."""
    messages = RosMessages("listen", "ros2")
    transport = DdsTransport(args.domain, messages)
    inlet = transport.inlet(args.topic, DETECTIONS, Qos.RELIABLE, 200)
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, frame: ended.append(number))
    print("listening", flush=True)
    rows = []
    while not ended:
        transport.wait(0.1)
        while (data := inlet.take()) is not None:
            arrived_ns = time.time_ns()
            array = messages.decode(data, DETECTIONS)
            stamp = array.header.stamp
            labels = [int(one.id) for one in array.detections]
            rows.append([stamp.sec * 10**9 + stamp.nanosec, arrived_ns, labels])
    print(json.dumps(rows), flush=True)
    transport.close()


def resident_mb(pid: int) -> float:
    """Return the memory that a process holds, MB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    return float("nan")


def processor_s(pid: int) -> float:
    """Return the processor time of a process so far, seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def machine_busy_s() -> float:
    """Return the processor time of all processes of the machine so far, seconds."""
    user, nice, system, _, _, irq, softirq, *_ = map(int, Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:])
    return (user + nice + system + irq + softirq) / os.sysconf("SC_CLK_TCK")


def udp_overflows() -> int:
    """Return the number of datagrams so far that the machine dropped because a receive buffer was full."""
    names, values = (
        line.split() for line in Path("/proc/net/snmp").read_text().splitlines() if line.startswith("Udp:")
    )
    return int(values[names.index("RcvbufErrors")])


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Run the three processes; return the figures."""
    here = [sys.executable, str(Path(__file__).resolve())]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as work:
        bag = Path(work) / "bag"
        limit = ["--last", str(args.distinct - 1)]
        convert = [sys.executable, "-m", "cuboid", "convert", str(args.recording), "--to", "mcap", "--output", str(bag)]
        subprocess.run([*convert, *limit], check=True, stdout=subprocess.DEVNULL)
        domain = ["--domain", str(args.domain)]
        count = round(args.seconds * args.hertz)
        listener = subprocess.Popen([*here, "listen", *domain], stdout=subprocess.PIPE, text=True, env=environment)
        settings = f"--pose {args.pose} --queue {args.queue} --json".split()
        track = [sys.executable, "-m", "cuboid", "ros2", *domain, *settings]
        node = subprocess.Popen(track, stdout=subprocess.PIPE, text=True, env=environment)
        frames = f"--hertz {args.hertz} --frames {count} --distinct {args.distinct} --wait --linger 1".split()
        play = [*here, "play", str(bag / "recording"), *domain, *frames]
        player = subprocess.Popen(play, stdout=subprocess.PIPE, text=True, env=environment)
        assert player.stdout is not None
        assert listener.stdout is not None
        assert node.stdout is not None
        while player.stdout.readline().strip() != "playing":
            pass
        begun_ns, memory, load = time.time_ns(), [], os.getloadavg()[0]
        processes = {"node": node.pid, "player": player.pid, "listener": listener.pid}
        before_s = {name: processor_s(pid) for name, pid in processes.items()}
        busy_s, overflows = machine_busy_s(), udp_overflows()
        used_s: dict[str, float] = {}
        while player.poll() is None:
            memory.append((time.time_ns() - begun_ns, resident_mb(node.pid)))
            with suppress(FileNotFoundError, ProcessLookupError):  # the player has just ended
                used_s |= {name: processor_s(pid) - before_s[name] for name, pid in processes.items()}
            time.sleep(0.5)
        busy_s = machine_busy_s() - busy_s
        sent = json.loads(player.stdout.readline())
        node.send_signal(signal.SIGINT)
        counts = json.loads(node.stdout.read())
        node.wait()
        listener.terminate()
        listener.stdout.readline()
        rows = json.loads(listener.stdout.readline())
    return figures(rows, memory, begun_ns, sent, args) | {
        "processor_s": {name: round(s, 1) for name, s in used_s.items()}
        | {"others": round(busy_s - sum(used_s.values()), 1)},
        "load_before": round(load, 1),
        "udp_overflows": udp_overflows() - overflows,
        "node": counts,
    }


def figures(
    rows: list[Any], memory: list[tuple[int, float]], begun_ns: int, sent: dict[str, Any], args: argparse.Namespace
) -> dict[str, Any]:
    """Return the figures of a run."""
    played = [row for row in rows if row[0] >= begun_ns]
    warm_ns = begun_ns + WARM_UP_S * 1e9
    latency_ms = np.array([(arrived - stamp) / 1e6 for stamp, arrived, _ in played if stamp >= warm_ns])
    held = np.array([(at_ns / 1e9, mb) for at_ns, mb in memory if at_ns / 1e9 >= WARM_UP_S])
    slope = np.polyfit(held[:, 0], held[:, 1], 1)[0] * 60 if len(held) > 2 else float("nan")
    third = max(len(held) // 3, 1)
    return {
        "hertz": args.hertz,
        "seconds": args.seconds,
        "sent": sent["sent"],
        "sent_late": sent["late"],
        "detected": len({stamp for stamp, _, _ in played}),
        "latency_ms": {
            "median": round(float(np.median(latency_ms)), 1),
            "p99": round(float(np.percentile(latency_ms, 99)), 1),
            "max": round(float(latency_ms.max()), 1),
        },
        "labels": len({label for _, _, labels in played for label in labels}),
        "memory_mb": {
            "first_third": round(float(held[:third, 1].mean()), 1),
            "last_third": round(float(held[-third:, 1].mean()), 1),
            "growth_per_minute": round(float(slope), 2),
        },
    }


def main() -> None:
    """Run what the arguments name."""
    if sys.argv[1:2] == ["play"]:
        parser = argparse.ArgumentParser(prog="ros2_loop.py play")
        parser.add_argument("bag", type=Path)
        parser.add_argument("--frames", type=int, default=10**9)
        parser.add_argument("--distinct", type=int, default=100, help="frames of the bag that are sent")
        parser.add_argument("--hertz", type=float, default=30.0)
        parser.add_argument("--wait", action="store_true", help="until somebody listens to color")
        parser.add_argument("--clock", action="store_true", help="send /clock, too")
        parser.add_argument("--first-ns", type=int, default=0, help="stamp of the first frame; else the time of now")
        parser.add_argument("--linger", type=float, default=0.0, help="seconds after the last frame")
        run = play
    elif sys.argv[1:2] == ["listen"]:
        parser = argparse.ArgumentParser(prog="ros2_loop.py listen")
        parser.add_argument("--topic", default="/cuboid/detections")
        run = listen
    else:
        parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("recording", type=Path)
        parser.add_argument("--seconds", type=float, default=60.0)
        parser.add_argument("--hertz", type=float, default=30.0)
        parser.add_argument("--pose", default="tf")
        parser.add_argument("--distinct", type=int, default=100)
        parser.add_argument("--json", type=Path)
        parser.add_argument("--queue", type=int, default=FRAMES_WAITING, help="images that wait for the tracker")
        run = None
    parser.add_argument("--domain", type=int, default=90)
    if run is not None:
        run(parser.parse_args(sys.argv[2:]))
        return
    args = parser.parse_args()
    found = measure(args)
    print(json.dumps(found, indent=2))
    if args.json is not None:
        args.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
