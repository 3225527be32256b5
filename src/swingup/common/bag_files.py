"""Columns of numbers in ROS's recordings: bags of ROS 1 (.bag) and ROS 2 (a folder, .db3, .mcap), read by rosbags.

Joint states are columns such as position.elbow, by the names in them, whatever their order. Their topic, or without
one the topic with the most messages, is the clock: in its rows, values of other topics are the latest ones before.
"""

import dataclasses
from bisect import bisect_right
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .errors import SwingupError, needing, one_line

BAG_FILES = (".bag", ".db3", ".mcap")
JOINT_STATE = "sensor_msgs/msg/JointState"
LARGEST_ARRAY = 16  # numbers of an array that are columns; images and point clouds have more
MAXIMUM_MESSAGES = 2_000_000
DEPTH = 4  # levels of messages within one another


class _Topic(NamedTuple):
    """The messages of a topic."""

    states: bool  # whether they are joint states
    times: list[int]  # when they were written (ns)
    rows: list[dict[str, float]]


def is_bag(path: str | Path) -> bool:
    """Whether a path is a recording of ROS."""
    return Path(path).suffix.lower() in BAG_FILES or (Path(path) / "metadata.yaml").is_file()


def read_bag(path: str | Path) -> dict[str, list[Any]]:
    """Columns by title, time (ns) first; a cell without a number is an empty text.

    Raises:
        SwingupError: rosbags is missing, or the recording cannot be read or holds no numbers.
    """
    with needing("rosbags", "ros", "reading a ROS bag"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    topics: dict[str, _Topic] = {}
    try:
        # Bags of ROS 2 before its release Iron do not hold the definitions of their messages.
        with AnyReader([Path(path)], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            for count, (connection, time, data) in enumerate(reader.messages()):
                if count >= MAXIMUM_MESSAGES:
                    raise SwingupError(f"it has more than {MAXIMUM_MESSAGES:,} messages: cut it")
                states = connection.msgtype == JOINT_STATE
                topic = topics.setdefault(connection.topic, _Topic(states, [], []))
                topic.times.append(time)
                topic.rows.append(dict(_numbers(reader.deserialize(data, connection.msgtype), connection.topic)))
    except Exception as error:  # a reader of foreign files raises anything
        raise SwingupError(f"cannot read {one_line(path)} as a ROS bag ({one_line(error, 120)})") from error
    topics = {name: topic for name, topic in topics.items() if any(topic.rows)}
    if not topics:
        raise SwingupError(f"{one_line(path)} has no message with numbers: record the joint states")
    clock = max(topics.values(), key=lambda topic: (topic.states, len(topic.times)))
    columns: dict[str, list[Any]] = {"time": _stamps(clock)}
    for topic in (clock, *(each for each in topics.values() if each is not clock)):
        latest = [bisect_right(topic.times, time) - 1 for time in clock.times]
        for title in dict.fromkeys(name for row in topic.rows for name in row if name != "stamp"):
            columns.setdefault(title, [topic.rows[k].get(title, "") if k >= 0 else "" for k in latest])
    return columns


def _stamps(topic: _Topic) -> list[Any]:
    """Times of a topic (ns): those of its headers where they have some."""
    stamps = [row.get("stamp", 0) for row in topic.rows]
    return stamps if all(stamps) else list(topic.times)


def _numbers(message: Any, topic: str) -> Iterator[tuple[str, Any]]:
    """Titles and numbers of a message."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None:
        yield "stamp", 10**9 * stamp.sec + stamp.nanosec
    if message.__msgtype__ == JOINT_STATE:
        for quantity in ("position", "velocity", "effort"):
            for joint, value in zip(message.name, getattr(message, quantity), strict=False):
                yield f"{quantity}.{joint}", float(value)
    else:
        yield from _fields(message, topic.strip("/").replace("/", "_"), DEPTH)


def _fields(value: Any, title: str, depth: int) -> Iterator[tuple[str, float]]:
    if isinstance(value, int | float):
        yield title, float(value)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.size <= LARGEST_ARRAY:
        yield from ((f"{title}{place}", float(each)) for place, each in enumerate(value))
    elif dataclasses.is_dataclass(value) and depth:
        for each in dataclasses.fields(value):
            if each.name not in ("header", "layout", "__msgtype__"):
                tail = "" if each.name == "data" else f".{each.name}"
                yield from _fields(getattr(value, each.name), title + tail, depth - 1)
