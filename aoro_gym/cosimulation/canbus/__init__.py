"""The machine as a CANopen node: gear, drive, brake and valves by a controller on a CAN bus."""

from pathlib import Path

DICTIONARY = Path(__file__).with_name("aoro.eds")
"""Object dictionary of the machine's node (EDS, CiA 306)."""
