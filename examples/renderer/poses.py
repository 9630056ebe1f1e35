"""Poses of the machine's parts as `aoro-gym serve --poses HOST:PORT` sends them, read with the standard library alone.

    aoro-gym export scene --out machine.glb
    aoro-gym serve --poses 127.0.0.1:47900
    python poses.py 47900

Write the loop at the end anew for your renderer: give each node of machine.glb its translation and rotation.
"""

import socket
import struct
import sys
import zlib

NODES = (
    "front_frame", "rear_frame",
    "arm_fl", "arm_fr", "arm_rl", "arm_rr", "wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr",
    "barrel_steering_left", "rod_steering_left", "barrel_steering_right", "rod_steering_right",
    "barrel_arm_fl", "rod_arm_fl", "barrel_arm_fr", "rod_arm_fr",
    "barrel_arm_rl", "rod_arm_rl", "barrel_arm_rr", "rod_arm_rr",
)  # fmt: skip
KIND, HEADER = 6, struct.Struct("<4sBBHQQQd")
PAYLOAD = struct.Struct(f"<{7 * len(NODES)}f")


def poses_of(datagram):
    """Simulated time [s], and of each node x, y, z [m] and the quaternion w, x, y, z; None for what is no such datagram."""
    if len(datagram) < HEADER.size + PAYLOAD.size + 4:
        return None
    magic, version, kind, length, _session, _sender, _sequence, time = HEADER.unpack_from(datagram)
    checksum = struct.unpack("<I", datagram[-4:])[0]
    if (magic, version, kind, length) != (b"AORO", 1, KIND, PAYLOAD.size) or zlib.crc32(datagram[:-4]) != checksum:
        return None
    numbers = PAYLOAD.unpack_from(datagram, HEADER.size)
    return time, {node: numbers[7 * k : 7 * k + 7] for k, node in enumerate(NODES)}


if __name__ == "__main__":
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind(("127.0.0.1", int(sys.argv[1])))
    while True:
        found = poses_of(listener.recv(2048))
        if found is not None:
            time, places = found
            x, y, z, *_ = places["front_frame"]
            print(f"{time:8.3f} s: front frame at {x:.3f} {y:.3f} {z:.3f} m")
