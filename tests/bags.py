"""Recordings of ROS 2 as robots write them."""

import numpy as np


def write_bag(folder, table, begin=0):
    """A folder with an MCAP file of rows [time, q1, q2, dq1, dq2, u1, u2]; it begins at a time (ns)."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    names = ["sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"]
    (state, header, stamp), none = (store.types[name] for name in names), np.zeros(0)
    numbers, layout = (store.types[f"std_msgs/msg/{name}"] for name in ("Float64MultiArray", "MultiArrayLayout"))
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        states = bag.add_connection("/joint_states", names[0], typestore=store)
        commands = bag.add_connection("/effort/commands", numbers.__msgtype__, typestore=store)
        for row in table:
            time = begin + round(1e9 * row[0])
            head = header(stamp=stamp(sec=time // 10**9, nanosec=time % 10**9), frame_id="")
            # Sorted by name, the elbow first.
            message = state(
                header=head, name=["elbow", "shoulder"], position=row[[2, 1]], velocity=none, effort=none
            )
            command = numbers(layout=layout(dim=[], data_offset=0), data=row[5:])
            bag.write(commands, max(0, time - 1000), store.serialize_cdr(command, numbers.__msgtype__))
            bag.write(states, time, store.serialize_cdr(message, names[0]))
