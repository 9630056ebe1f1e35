"""Ctrl-C is neither lost nor early where it is deferred."""

import contextlib
import signal
import subprocess
import sys
from threading import Thread

import pytest

from aoro_gym.execution.interrupts import interrupt_deferred

IMPORTING = """
import os, signal, sys

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "trimesh.caching":
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, Interrupting())
try:
    import aoro_gym.terrains.io.mesh_files
except KeyboardInterrupt:
    sys.exit(7 if "trimesh" in sys.modules else 8)
"""


def test_an_interrupt_is_raised_afterwards():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    done = []
    try:
        with pytest.raises(KeyboardInterrupt), interrupt_deferred():
            with contextlib.suppress(BaseException):  # as trimesh's imports do
                signal.raise_signal(signal.SIGINT)
            done.append(True)
        assert done and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        with interrupt_deferred():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_another_thread_goes_on():
    done = []

    def work():
        with interrupt_deferred():
            done.append(True)

    thread = Thread(target=work)
    thread.start()
    thread.join()
    assert done


def test_trimesh_is_whole_when_its_import_is_interrupted():
    assert subprocess.run([sys.executable, "-c", IMPORTING], timeout=60.0, check=False).returncode == 7
