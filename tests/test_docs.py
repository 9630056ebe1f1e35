"""What README and the documentation show and name is there: examples run, commands, links and paths exist."""

import re
import runpy
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

from aoro_gym.cli import app

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FOLDERS = "aoro_gym|envs|terrains|agents|tests|studies|docs|examples"


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path, language: str) -> list[str]:
    """Fenced blocks of a page in a language."""
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.mark.parametrize(
    # tutorials run as a whole: tests/test_docs_commands.py
    "page",
    [page for page in PAGES if blocks(page, "python") and page.parent.name != "tutorials"],
    ids=name_of,
)
def test_examples_run(page, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for block in blocks(page, "python"):
        exec(compile(block, page.name, "exec"), {})


def test_pages_have_examples():
    assert blocks(ROOT / "README.md", "python")
    assert commands(ROOT / "README.md")


def commands(page: Path) -> list[str]:
    """Command lines of a page that call ``aoro-gym``."""
    lines = (line for block in blocks(page, "sh") for line in block.splitlines())
    return [line for line in lines if line.startswith("aoro-gym ")]


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=name_of)
def test_commands_have_the_options_that_are_shown(page):
    whole = typer.main.get_command(app)
    for line in commands(page):
        command: Any = whole
        words = iter(shlex.split(line, comments=True)[1:])
        while hasattr(command, "commands"):
            word = next(words)
            assert word in command.commands, f"{line}: there is no {word}"
            command = command.commands[word]
        known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
        assert {word for word in words if word.startswith("-") and word.lstrip("-")[:1].isalpha()} <= known, line


@pytest.mark.parametrize("page", [*PAGES, *sorted((ROOT / "studies").rglob("*.md"))], ids=name_of)
def test_links_and_paths_lead_to_files(page):
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)#\s]+)", text):
        if not link.startswith(("https://", "http://")):
            assert (page.parent / link).exists(), f"{page.name} links to {link}"
    for path in re.findall(rf"`((?:{FOLDERS})/[^`\s]*)`", text):
        assert any(ROOT.glob(path.rstrip("/"))), f"{page.name} names {path}"
    for module in re.findall(r"\bpython\s-m\s(aoro_gym\.[\w.]+|studies\.[\w.]+|tests\.[\w.]+)", text):
        place = ROOT / module.replace(".", "/")
        assert place.with_suffix(".py").exists() or (place / "__main__.py").exists(), f"{page.name} runs {module}"


def test_pictures_are_as_drawn_and_name_files():
    for name, text in runpy.run_path(str(ROOT / "docs/diagrams.py"))["PICTURES"].items():
        drawn = (ROOT / "docs/pictures" / name).read_text(encoding="utf-8")
        assert drawn == text, f"run `python docs/diagrams.py`: {name} is another one"
        for path in re.findall(rf"\b(?:{FOLDERS})/[^\s<,]*", drawn):
            assert any(ROOT.glob(path)), f"{name} names {path}"


def test_tables_of_laws_are_as_the_code_has_them():
    made = runpy.run_path(str(ROOT / "docs/laws.py"))
    assert made["PAGE"].read_text(encoding="utf-8") == made["page"](), "run `python docs/laws.py`"


def test_tables_of_records_are_as_the_code_has_them():
    made = runpy.run_path(str(ROOT / "docs/records.py"))
    assert made["PAGE"].read_text(encoding="utf-8") == made["page"](), "run `python docs/records.py`"


def test_tables_of_environments_are_as_the_code_has_them():
    for page, text in runpy.run_path(str(ROOT / "docs/environments.py"))["pages"]().items():
        assert page.read_text(encoding="utf-8") == text, "run `python docs/environments.py`"


def test_the_sample_logs_are_read():
    from aoro_gym.diagnosis.recording import read_recording

    for name in ("healthy", "later"):
        found = read_recording(ROOT / f"docs/sample/logs/{name}.csv")
        assert {"joint_angle", "pressure_a", "pressure_b", "pump_pressure"} <= set(found.channels)


def test_the_sample_report_names_no_folder_of_the_machine_that_made_it():
    for file in (ROOT / "docs/sample").rglob("*"):
        if file.suffix in (".html", ".json", ".toml"):
            assert not re.search(r"/(tmp|home|root|work|Users)/", file.read_text()), file


def test_every_page_is_on_the_site():
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("nav:")[2]
    listed = set(re.findall(r"[\w/]+\.md", nav))
    assert listed == {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}


def test_the_readme_can_be_read_in_ten_minutes():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 1500


def test_examples_are_short():
    for file in (ROOT / "examples").glob("*.py"):
        assert len(file.read_text(encoding="utf-8").splitlines()) <= 80, file.name


def test_slow_tests_are_named():
    slow = {
        name_of(file) for file in (ROOT / "tests").rglob("test_*.py") if f"mark.{'slow'}" in file.read_text("utf-8")
    }
    page = (ROOT / "docs/development.md").read_text(encoding="utf-8")
    named = set(re.findall(r"(?m)^\| `(tests/[\w/]+\.py)` \|", page))
    assert sorted(named) == sorted(slow), "name slow tests in docs/development.md"
