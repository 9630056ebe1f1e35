"""A full turn to the left: simulate it, and hold its key figures against the published ones.

You learn how to load a machine, make a twin of it, drive it through a manoeuvre, and plot what it did (``turn.png``).
"""

from pathlib import Path

from aoro_gym import Machine, Twin
from aoro_gym.simulation.key_figures import recording_figures
from aoro_gym.simulation.manoeuvres import run, standing_turn
from aoro_gym.simulation.plots import Section, write_png
from aoro_gym.validation import FIGURES, published_rows

machine = Machine.load("aoro")
turn = standing_turn(direction=+1, signal=1.0, joint_range=float(machine.joint.range))
recording = run(Twin(machine=machine), turn)  # channels by name, in SI units, at 1 kHz
figures = recording_figures(recording, machine.steering.cylinder)

published = {
    row["source"]: row for row in published_rows() if (row["direction"], row["signal_percent"]) == ("left", 100.0)
}
print(f"{'':28} {'this twin':>10} {'published twin':>15} {'real machine':>13}")
for name in FIGURES:
    print(f"{name:28} {figures[name]:10.3f} {published['mevea'][name]:15.3f} {published['physical'][name]:13.3f}")

write_png(Path("turn.png"), Section(recording, figures))
