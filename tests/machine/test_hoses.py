"""Lines given by hoses: volume and modulus against closed forms, and what is refused."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.machine import Machine
from aoro_gym.machine.hoses import LINES, STEEL, modulus_of_expansion, modulus_of_tube, volume

HOSE = """
length_m = 3.0
diameter_mm = 16
"""


def load(folder: Path, text: str, base: str = "aoro_datasheet") -> Machine:
    file = folder / "mine.toml"
    file.write_text(f'base = "{base}"\n{text}')
    return Machine.load(file)


def test_a_volume_by_hand():
    """Of 16 mm and 3 m: 0.603 L, as the data sheet's source of the joint's hoses has it (0.60)."""
    assert volume(3.0, 0.016) == pytest.approx(math.pi * 0.008**2 * 3.0, rel=1e-15)
    assert volume(2.0, 0.016, count=3) == pytest.approx(2.0 * volume(3.0, 0.016), rel=1e-15)
    assert 1e3 * volume(3.0, 0.016) == pytest.approx(0.603, abs=5e-4)


def test_a_thin_tube_widens_by_its_hoop_stress():
    """B = E s / d up to the first order of s / d: D² / (D² - d²) and its like make (1 - ν) and 1 of it."""
    for wall in (1e-4, 1e-5):
        thin = STEEL[0] * wall / 0.02
        assert modulus_of_tube(0.02, wall) == pytest.approx(thin, rel=2.0 * wall / 0.02)
    # by hand, 12 mm inside and 2 mm of wall: (256 + 144) / (256 - 144) + 0.3 = 3.871
    assert modulus_of_tube(0.012, 0.002) == pytest.approx(0.5 * 206e9 / (400.0 / 112.0 + 0.3), rel=1e-15)


def test_an_expansion_is_a_secant():
    """Hose whose wall has the modulus B takes V p / B more at p."""
    bore, pressure, modulus = 0.0127, 210e5, 1.2e9
    expansion = volume(1.0, bore) * pressure / modulus
    assert modulus_of_expansion(bore, expansion, pressure) == pytest.approx(modulus, rel=1e-15)


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize(
    ("wall", "modulus"),
    [
        ('type = "double wire braid"', 1.2e9),
        ('type = "four steel spirals"', 1.64e9),
        ("expansion_cm3_per_m = 4.0\nexpansion_bar = 200", 200e5 * math.pi * 0.008**2 / 4e-6),
        ('type = "steel tube"\nwall_mm = 2', 0.5 * 206e9 / ((400.0 + 256.0) / (400.0 - 256.0) + 0.3)),
    ],
)
def test_a_line_has_the_volume_and_the_modulus_of_its_hoses(tmp_path, line, wall, modulus):
    machine = load(tmp_path, f'[{line}]{HOSE}count = 2\n{wall}\nsource = "measured"\n')
    sheet = Machine.load("aoro_datasheet")
    oil, stiff = (machine.entries[key] for key in LINES[line])
    assert oil.si == pytest.approx(2.0 * math.pi * 0.008**2 * 3.0, rel=1e-12)
    assert stiff.si == pytest.approx(modulus, rel=1e-12)
    for entry in (oil, stiff):
        assert entry.range[0] < entry.value < entry.range[1]
        assert entry.source.endswith("; measured") and entry.source[0] in "DP"
        assert (entry.role, entry.published) == (sheet.entries[entry.key].role, sheet.entries[entry.key].published)
    others = [key for key in sheet.entries if key not in LINES[line]]
    assert all(machine.entries[key].si == sheet.entries[key].si for key in others)


def test_the_twin_has_the_compliance_of_oil_and_hose_in_series(tmp_path):
    """1/β = 1/β_oil + 1/B of a line, as published; the wall's share is V/B."""
    machine = load(tmp_path, f'[steering.hose]{HOSE}type = "four steel spirals"\n')
    assert float(np.squeeze(machine.steering.hose_compliance)) == pytest.approx(
        math.pi * 0.008**2 * 3.0 / 1.64e9, rel=1e-12
    )


def test_what_stands_on_a_hose_may_replace_it_and_a_saved_file_keeps_its_values(tmp_path):
    first = tmp_path / "first.toml"
    first.write_text(f'base = "aoro"\n[steering.hose]{HOSE}type = "four steel spirals"\n')
    machine = load(tmp_path, "[steering.hose_volume]\nvalue = 0.5\n", base="first.toml")
    assert machine.entries["steering.hose_volume"].value == 0.5
    assert machine.entries["steering.hose_bulk_modulus"].value == 1.64e9
    machine.save(tmp_path / "saved.toml", base="aoro")
    again = Machine.load(tmp_path / "saved.toml")
    assert again.identity == machine.identity and "hose]" not in (tmp_path / "saved.toml").read_text()


def test_bundled_machines_give_volume_and_modulus(tmp_path):
    """So hoses change none of them: an overlay without one is the same to the bit."""
    for name in ("aoro", "aoro_datasheet", "aoro_physical"):
        machine, same = Machine.load(name), load(tmp_path, "", base=name)
        assert all(same.entries[key].si == machine.entries[key].si for key in machine.entries)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("diameter_mm = 16", "steering.hose: lacks length_m, in m, the length of one hose"),
        (
            'length_m = 3\ndiameter_mm = 0.016\ntype = "double wire braid"',
            "diameter_mm = 0.016: must be from 2 to 100 mm",
        ),
        (
            f'{HOSE}type = "textile"',
            "type = 'textile': must be one of double wire braid, four steel spirals, steel tube; of",
        ),
        (f'{HOSE}type = "double wire braid"\ncount = 1.5', "count = 1.5: must be from 1 to 8 hoses side by side"),
        (f"{HOSE}expansion_cm3_per_m = 4", "give either type or both expansion_cm3_per_m and expansion_bar"),
        (f"{HOSE}", "give either type or both"),
        (f'{HOSE}type = "steel tube"', "wall_mm belongs to type = 'steel tube', which needs it"),
        (f'{HOSE}type = "double wire braid"\nlenght = 3', "unknown field 'lenght'; a hose has length_m, diameter_mm"),
        (
            f'{HOSE}type = "double wire braid"\n[steering.hose_volume]\nvalue = 0.4',
            "give the hose or steering.hose_volume",
        ),
        ("length_m = nan\ndiameter_mm = 16", "length_m = nan: must be from 0.05 to 100 m"),
        (f'{HOSE}type = ["double wire braid"]', "must be one of double wire braid"),
    ],
)
def test_what_is_no_hose_is_named_with_its_bound_and_what_to_give(tmp_path, text, message):
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        load(tmp_path, f"[steering.hose]\n{text}\n")
    assert "mine.toml" in str(caught.value) and "\n" not in str(caught.value)
