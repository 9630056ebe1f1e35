"""A tracking script: follows a recorded GPS path by pure pursuit, over the machine's own interfaces.

It imports nothing but Python's standard library, and knows the machine by what stands in its manual: GPS sentences arrive
over TCP, the other sensors in records over UDP, and commands go back in volts.

    aoro-gym serve --terrain ground.ply --path path.gpx
    python track.py --path path.gpx

It ends where the path does. The controller is the one of ``aoro_gym.agents.controllers.path_tracking``: dead reckoning
between the solutions of the GPS, pure pursuit (R. C. Coulter, CMU-RI-TR-92-01, 1992), a joint loop over the dead
band.
"""

import argparse
import bisect
import contextlib
import csv
import hashlib
import hmac
import itertools
import math
import secrets
import select
import socket
import struct
import sys
import time
import xml.etree.ElementTree
import zlib
from collections import deque

# ---- records: see the how-to "Software in the loop"

HEADER = struct.Struct("<4sBBHQQQd")
HELLO, STATE, COMMAND, TELEMETRY, GRANT = 1, 2, 3, 4, 5
STATE_LAYOUT = struct.Struct("<Bdd")
TELEMETRY_LAYOUT = struct.Struct("<dQBB31f")
COMMAND_LAYOUT = struct.Struct("<11fB")
GRANT_LAYOUT = struct.Struct("<d")
NEUTRAL = [2.5, 2.5, 0.5, 2.5, 2.5, 2.5, 2.5, 4.5, 4.5, 4.5, 4.5]
"""Volts of steering, drive, brake, four arms and four traction valves."""


class Machine:
    """The machine's sockets."""

    def __init__(self, udp, tcp, token=None):
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.connect(udp)
        self.udp.setblocking(False)
        self.tcp_address, self.tcp, self.rest = tcp, None, b""
        self.token = token
        self.session, self.sender, self.sequence = 0, 1 + secrets.randbelow(2**53 - 1), 0
        self.last_sequence = 0
        self.last_hello = -math.inf

    def send(self, kind, payload=b"", instant=0.0):
        self.sequence += 1
        head = HEADER.pack(b"AORO", 1, kind, len(payload), self.session, self.sender, self.sequence, instant)
        body = head + payload
        if self.token:
            body += hmac.digest(self.token, body, hashlib.sha256)[:16]
        with contextlib.suppress(OSError):  # nobody is there yet
            self.udp.send(body + struct.pack("<I", zlib.crc32(body)))

    def hello(self):
        """Ask who is there, at most twice a second."""
        if time.monotonic() - self.last_hello > 0.5:
            self.last_hello = time.monotonic()
            self.send(HELLO)
            if self.tcp is None:
                self._connect()

    def forget(self):
        """The server is silent: it may have been started anew."""
        self.session, self.last_sequence = 0, 0

    def wait(self, seconds):
        select.select([one for one in (self.udp, self.tcp) if one is not None], [], [], seconds)

    def records(self):
        """Kind, time and payload of what arrived over UDP."""
        while True:
            try:
                datagram = self.udp.recv(2048)
            except OSError:
                return
            if len(datagram) < 44 or struct.unpack("<I", datagram[-4:])[0] != zlib.crc32(datagram[:-4]):
                continue
            magic, version, kind, length, session, _, sequence, instant = HEADER.unpack_from(datagram)
            body = datagram[: 40 + length]
            tag = hmac.digest(self.token, body, hashlib.sha256)[:16] if self.token else b""
            if (magic, version) != (b"AORO", 1) or not hmac.compare_digest(datagram[40 + length : -4], tag):
                continue
            if session != self.session:
                if kind == STATE and not self.session:
                    self.session = session
                    self.send(HELLO)  # naming the session: telemetry, please
                continue
            if sequence > self.last_sequence:
                self.last_sequence = sequence
                yield kind, instant, datagram[40 : 40 + length]

    def sentences(self):
        """Fields of the GPS sentences that arrived over TCP, their checksums checked."""
        while self.tcp is not None:
            try:
                part = self.tcp.recv(65536)
            except BlockingIOError:
                break
            except OSError:
                part = b""
            if not part:
                self.tcp.close()
                self.tcp = None
                break
            self.rest += part
        *lines, self.rest = self.rest.split(b"\r\n")
        for line in lines:
            text, _, check = line.decode("ascii", "replace").partition("*")
            value = 0
            for character in text[1:]:
                value ^= ord(character)
            if text.startswith("$") and check == f"{value:02X}":
                yield text[1:].split(",")

    def _connect(self):
        try:
            self.tcp = socket.create_connection(self.tcp_address, timeout=1.0)
            self.tcp.setblocking(False)
            self.rest = b""
        except OSError:
            self.tcp = None


# ---- geography


class Plane:
    """The plane that touches the Earth (WGS 84) at a place: x east, y north [m]."""

    def __init__(self, latitude, longitude):
        self.origin = latitude, longitude
        eccentricity = 6.69437999014e-3
        flat = 1.0 - eccentricity * math.sin(math.radians(latitude)) ** 2
        across = 6378137.0 / math.sqrt(flat)
        self.north = math.radians(across * (1.0 - eccentricity) / flat)  # [m/deg]
        self.east = math.radians(across * math.cos(math.radians(latitude)))

    def place(self, latitude, longitude):
        return (longitude - self.origin[1]) * self.east, (latitude - self.origin[0]) * self.north


def degrees(text, side):
    """Latitude or longitude [deg] of a sentence: ddmm.mmmm."""
    point = text.index(".")
    value = float(text[: point - 2]) + float(text[point - 2 :]) / 60.0
    return -value if side in "SW" else value


def read_places(file):
    """Latitude and longitude [deg] of the points of a GPX track, or of a CSV with such columns."""
    if file.endswith(".gpx"):
        return [
            (float(point.attrib["lat"]), float(point.attrib["lon"]))
            for point in xml.etree.ElementTree.parse(file).iter()
            if point.tag.rpartition("}")[2] == "trkpt"
        ]
    with open(file, newline="", encoding="utf-8") as lines:
        return [(float(row["latitude_deg"]), float(row["longitude_deg"])) for row in csv.DictReader(lines)]


class Path:
    """A line to follow [m], evenly spaced, the recording's noise averaged out; closed if it ends where it began."""

    SPACING, AVERAGED = 0.25, 1.0

    def __init__(self, points):
        self.closed = math.dist(points[0], points[-1]) < 1.5 and len(points) > 20
        kept = [points[0]]
        for point in points[1:]:
            if math.dist(point, kept[-1]) > 0.02:
                kept.append(point)
        s = [0.0]
        for before, after in itertools.pairwise(kept):
            s.append(s[-1] + math.dist(before, after))
        count = max(int(s[-1] / self.SPACING), 1)
        fine = [
            self._at(kept, s, 0.1 * self.SPACING * n * s[-1] / (count * self.SPACING)) for n in range(10 * count + 1)
        ]
        half = round(0.5 * self.AVERAGED / (0.1 * self.SPACING))
        self.points = []
        for n in range(0, 10 * count + 1, 10):
            if self.closed:
                near = [fine[k % (10 * count)] for k in range(n - half, n + half + 1)]
            else:
                reach = min(half, n, 10 * count - n)
                near = fine[n - reach : n + reach + 1]
            self.points.append((sum(x for x, _ in near) / len(near), sum(y for _, y in near) / len(near)))
        self.s = [0.0]
        for before, after in itertools.pairwise(self.points):
            self.s.append(self.s[-1] + math.dist(before, after))
        self.length = self.s[-1]

    @staticmethod
    def _at(points, s, where):
        n = min(max(bisect.bisect_right(s, where), 1), len(s) - 1)
        share = (where - s[n - 1]) / (s[n] - s[n - 1])
        (x0, y0), (x1, y1) = points[n - 1], points[n]
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0)

    def position(self, where):
        """Place at arc length ``where`` [m]; beyond the ends on their prolongations."""
        return self._at(self.points, self.s, where % self.length if self.closed else where)

    def project(self, x, y, near, reach):
        """Arc length [m] of the nearest place within ``reach`` [m] of the last one."""
        best = (math.inf, near)
        segments = len(self.points) - 1
        begin = math.floor((near - reach) / self.SPACING)
        for k in range(begin, begin + int(2.0 * reach / self.SPACING) + 3):
            if not self.closed and not 0 <= k < segments:
                continue
            n = k % segments
            (x0, y0), (x1, y1) = self.points[n], self.points[n + 1]
            dx, dy = x1 - x0, y1 - y0
            share = ((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy)
            share = min(max(share, 0.0), 1.0)
            distance = math.hypot(x - x0 - share * dx, y - y0 - share * dy)
            if distance < best[0]:
                best = (distance, self.s[n] + share * (self.s[n + 1] - self.s[n]))
        return best[1]


# ---- where the machine is, and how it is steered

FRONT, REAR = 1.774, 1.717  # [m] from the hinge to the axles
ANTENNA = (1.0, 0.6, 2.2)  # [m] of the main antenna, in the front frame's axes, from the ground below the hinge
RADIUS = 0.665  # [m] of the wheels, rolling
LARGEST_ANGLE = math.radians(40.0)
GPS_GAIN = {4: 0.4, 5: 0.02}  # by quality: fixed, float
LOOK_AHEAD, GAIN, LEAD_TIME, REST_ERROR = 0.891, 1.04, 0.0212, 0.0498
DEAD_BAND_LEFT, DEAD_BAND_RIGHT = 0.135, 0.175
DRIVE = 0.66
CONTROL_STEP, RATE_SPAN = 0.05, 0.05  # [s] between two commands; [s] of angles that the joint's rate is taken from


def wrapped(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def in_world(roll, pitch, yaw, x, y, z):
    """Plan components of a vector of the front frame's axes."""
    y, z = math.cos(roll) * y - math.sin(roll) * z, math.sin(roll) * y + math.cos(roll) * z
    x = math.cos(pitch) * x + math.sin(pitch) * z
    return math.cos(yaw) * x - math.sin(yaw) * y, math.sin(yaw) * x + math.cos(yaw) * y


class Tracker:
    """Estimates the pose of the middle of the front axle, and steers it along a path."""

    def __init__(self, path, plane):
        self.path, self.plane = path, plane
        self.x = self.y = self.heading = 0.0
        self.located = False
        self.s = 0.0
        self.known = False  # where on the path
        self.angles = deque()
        self.solution = None  # utc, x, y, heading, quality of one that was not used yet
        self.partial = None
        self.driven = 0.0  # [m] along the path

    def hear(self, fields):
        """A GPS sentence."""
        if fields[0].endswith("GGA"):
            self.partial = None
            if fields[6] in ("4", "5"):
                hour, minute, second = int(fields[1][:2]), int(fields[1][2:4]), float(fields[1][4:])
                x, y = self.plane.place(degrees(fields[2], fields[3]), degrees(fields[4], fields[5]))
                self.partial = (3600.0 * hour + 60.0 * minute + second, x, y, int(fields[6]))
        elif fields[0].endswith("HDT") and self.partial is not None and fields[1]:
            utc, x, y, quality = self.partial
            self.solution = (utc, x, y, math.radians(90.0 - float(fields[1])), quality)

    def see(self, instant, values):
        """A record of telemetry: keep the joint angle."""
        self.angles.append((instant, values["joint_angle"]))
        while self.angles[0][0] < instant - RATE_SPAN - 1e-6:
            self.angles.popleft()

    def control(self, values):
        """Volts for the next control step, or None while nothing is known; True in the second place at the path's end."""
        speeds = sorted(values["wheel_speeds"])
        speed = RADIUS * 0.5 * (speeds[1] + speeds[2])
        self._locate(values, speed)
        if not self.located:
            return None, False
        reach = 1.5 if self.known else 10.0
        before = self.s
        self.s = self.path.project(self.x, self.y, self.s, reach)
        gained = self.s - before
        if self.path.closed:
            gained = (gained + 0.5 * self.path.length) % self.path.length - 0.5 * self.path.length
        self.driven += gained if self.known else 0.0
        self.known = True
        ended = not self.path.closed and self.s >= self.path.length - 0.25
        return self._steered(values["joint_angle"]), ended

    def _locate(self, values, speed):
        rate, step = values["yaw_rate"], CONTROL_STEP
        if self.located:
            direction = self.heading + 0.5 * step * rate
            self.x += step * speed * math.cos(direction)
            self.y += step * speed * math.sin(direction)
            self.heading += step * rate
        if self.solution is None:
            return
        utc, x, y, heading, quality = self.solution
        self.solution = None
        age = (values["utc"] - utc) % 86400.0
        lever = in_world(values["roll"], values["pitch"], heading, FRONT - ANTENNA[0], -ANTENNA[1], -ANTENNA[2])
        direction = heading + 0.5 * rate * age
        x += lever[0] + speed * age * math.cos(direction)
        y += lever[1] + speed * age * math.sin(direction)
        heading += rate * age
        if not self.located:
            self.x, self.y, self.heading, self.located = x, y, heading, True
            return
        gain = GPS_GAIN[quality]
        self.x += gain * (x - self.x)
        self.y += gain * (y - self.y)
        self.heading = wrapped(self.heading + gain * wrapped(heading - self.heading))

    def _steered(self, angle):
        px, py = self.path.position(self.s + LOOK_AHEAD)
        dx, dy = px - self.x, py - self.y
        c, s = math.cos(self.heading), math.sin(self.heading)
        ahead, left = c * dx + s * dy, c * dy - s * dx
        curvature = 2.0 * left / (ahead * ahead + left * left)
        lean = math.atan(curvature * FRONT)
        wanted = lean + math.asin(min(max(curvature * REAR * math.cos(lean), -1.0), 1.0))
        wanted = min(max(wanted, -LARGEST_ANGLE), LARGEST_ANGLE)
        error = wanted - angle - LEAD_TIME * self._joint_rate()
        signal = min(max(GAIN * error, -1.0), 1.0)
        skipped = DEAD_BAND_LEFT if signal > 0.0 else DEAD_BAND_RIGHT
        signal = math.copysign(skipped + (1.0 - skipped) * abs(signal), signal) if abs(error) > REST_ERROR else 0.0
        volts = list(NEUTRAL)
        volts[0], volts[1] = 2.5 - 2.0 * signal, 2.5 + 2.0 * DRIVE
        return volts

    def _joint_rate(self):
        """Slope of the line through the last angles [rad/s]."""
        if len(self.angles) < 2:
            return 0.0
        mean = sum(instant for instant, _ in self.angles) / len(self.angles)
        spread = sum((instant - mean) ** 2 for instant, _ in self.angles)
        return sum((instant - mean) * angle for instant, angle in self.angles) / spread


def telemetry(payload):
    """Values by name of a record."""
    numbers = TELEMETRY_LAYOUT.unpack(payload)
    return {
        "utc": numbers[0],
        "joint_angle": numbers[4],
        "wheel_speeds": numbers[5:9],
        "roll": numbers[9],
        "pitch": numbers[10],
        "yaw_rate": numbers[13],
        "watchdog": numbers[2],
    }


BRAKED = [2.5, 2.5, 4.5, *NEUTRAL[3:]]


class Driver:
    """Drives the machine along the path."""

    def __init__(self, machine, tracker, gear=1):
        self.machine, self.tracker, self.gear = machine, tracker, gear
        self.time, self.values = -1.0, None
        self.lock_step, self.arrived = False, None
        self.commands = 0
        self.ended = False

    def read(self):
        """Take in all that arrived; whether a control step is due."""
        due = False
        for kind, instant, payload in self.machine.records():
            if kind == STATE:
                self.lock_step, self.arrived = bool(STATE_LAYOUT.unpack(payload)[0]), instant
            elif kind == TELEMETRY:
                self.time, self.values = instant, telemetry(payload)
                self.tracker.see(instant, self.values)
                due |= round(instant / 0.01) % round(CONTROL_STEP / 0.01) == 0
        for fields in self.machine.sentences():
            self.tracker.hear(fields)
        return due

    def act(self):
        """One control step."""
        volts, ended = self.tracker.control(self.values)
        self.ended |= ended
        if volts is not None:
            volts = BRAKED if self.ended else volts
            self.machine.send(COMMAND, COMMAND_LAYOUT.pack(*volts, self.gear), self.time)
            self.commands += 1

    def run(self, until):
        """In real time: read and act as records arrive."""
        heard = time.monotonic()
        while not until():
            self.machine.wait(0.2)
            before = self.time, self.machine.session
            if self.read():
                self.act()
            now = time.monotonic()
            if (self.time, self.machine.session) != before:
                heard = now
            if now - heard > 1.0 and self.machine.session:
                self.machine.forget()
            if now - heard > 0.2 or now - self.machine.last_hello > 2.0 or self.machine.tcp is None:
                self.machine.hello()
            if self.machine.session and self.lock_step:
                return

    def run_in_lock_step(self, until, pace):
        """Grant a control step after the other, at most ``pace`` times as fast as real time."""
        begun, first, number = time.monotonic(), max(self.arrived or 0.0, 0.0), 0
        while not until():
            number += 1
            granted = first + number * CONTROL_STEP
            self.machine.send(GRANT, GRANT_LAYOUT.pack(granted))
            asked = time.monotonic()
            while self.arrived is None or self.arrived < granted - 1e-4:
                self.machine.wait(0.5)
                self.read()
                if time.monotonic() - asked > 1.0:  # lost, or too much at once: the same again changes nothing
                    asked = time.monotonic()
                    self.machine.send(GRANT, GRANT_LAYOUT.pack(granted))
                    if self.machine.tcp is None:
                        self.machine.hello()
            self.read()
            if self.values is not None:
                self.act()
            if pace:
                ahead = (granted - first) / pace - (time.monotonic() - begun)
                if ahead > 0.0:
                    time.sleep(ahead)


def address(text):
    host, _, port = text.rpartition(":")
    return host, int(port)


def main():
    parser = argparse.ArgumentParser(description="Follow a recorded GPS path.")
    parser.add_argument("--path", required=True, help="GPX track, or CSV with latitude_deg and longitude_deg")
    parser.add_argument("--udp", type=address, default=("127.0.0.1", 47800))
    parser.add_argument("--tcp", type=address, default=("127.0.0.1", 47801))
    parser.add_argument("--token", default="")
    parser.add_argument("--pace", type=float, default=0.0, help="in lock-step: at most so many times real time")
    parser.add_argument("--seconds", type=float, default=math.inf, help="simulated time to end after")
    parser.add_argument("--gear", type=int, default=1)
    asked = parser.parse_args()
    places = read_places(asked.path)
    plane = Plane(*places[0])
    tracker = Tracker(Path([plane.place(*place) for place in places]), plane)
    driver = Driver(Machine(asked.udp, asked.tcp, asked.token.encode() or None), tracker, asked.gear)
    stopped = None

    def over():
        nonlocal stopped
        if driver.ended and stopped is None:
            stopped = driver.time
        return driver.time >= asked.seconds or (stopped is not None and driver.time > stopped + 1.0)

    driver.machine.hello()
    driver.run(over)
    if driver.lock_step:
        driver.run_in_lock_step(over, asked.pace)
    print(
        f"{driver.commands} commands, {driver.time:.2f} s of the machine's time, {tracker.driven:.2f} m along the path"
    )
    return 0 if driver.ended or driver.time >= asked.seconds else 1


if __name__ == "__main__":
    sys.exit(main())
