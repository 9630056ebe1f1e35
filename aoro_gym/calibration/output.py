"""What a calibration writes: a machine file, its ensemble and a report, each whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from aoro_gym.calibration.published import Calibration
from aoro_gym.calibration.resuming import remove_folder, unfinished_folder
from aoro_gym.execution.files import check_writable, write_json
from aoro_gym.execution.locking import locked


def check_output(out: Path, logs: Sequence[Path] = ()) -> None:
    """ValueError unless a machine file can be written to ``out``, which is no manifest of ``logs``."""
    if out.suffix != ".toml":
        raise ValueError(f"--out {out} must end in .toml")
    check_writable(out)
    for path in logs:
        if out.resolve() in (path.resolve(), path.with_suffix(".toml").resolve()):
            raise ValueError(f"--out {out} would replace the manifest of {path}; name another file")


def calibrate_to(
    out: Path, fit: Callable[[Path], Calibration], *, force: bool = False
) -> tuple[Calibration, list[Path]]:
    """Calibrate, and write the machine file ``out``, its report and its ensemble; gives what was found and written.

    A machine that does not fit is not written, only the report, unless ``force``; the parts of the calibration are kept
    then, so that the same with ``force`` need not be computed again.

    Args:
        out: Machine file (.toml). The report stands beside it (.json), the ensemble in the folder ``NAME_ensemble``.
        fit: Calibrates, and keeps its parts in the folder that it is given.
        force: Write the machine whatever the verdict says; its parameters' sources then tell it.

    Raises:
        FolderInUse: another process calibrates to ``out``.
        OSError: a file cannot be written; what stood there before is left.
    """
    folder = unfinished_folder(out)
    with locked(folder):
        found = fit(folder)
        written = []
        if found.fits or force:
            written += _write_ensemble(out, found)
            written.append(out)
        report = out.with_suffix(".json")
        write_json(report, found.report | {"machine_file": str(out) if written else None})
        if written:
            found.machine.save(out)  # last: where it stands, everything does
            remove_folder(folder)
    return found, [*written[::-1], report]


def _write_ensemble(out: Path, found: Calibration) -> list[Path]:
    folder = out.with_name(f"{out.stem}_ensemble")
    paths = [folder / f"{index + 1:02d}.toml" for index in range(len(found.ensemble))]
    for path, member in zip(paths, found.ensemble, strict=True):
        member.save(path)
    for old in set(folder.glob("[0-9][0-9].toml")) - set(paths) if paths else ():
        old.unlink()
    return paths
