"""The command ``aoro-gym``: a file a group of commands, each of which parses, calls and prints.

Input is checked before anything runs: what is wrong is said in one line, with exit code 2. A run that fails ends with
exit code 1. Tables and JSON go to the standard output, progress and errors to the standard error.
"""

from aoro_gym.cli.app import app, main

__all__ = ["app", "main"]
