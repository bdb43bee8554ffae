"""`docs/library.md` names objects that the package has."""

import re
from pathlib import Path

import dunkelfeld as df

PAGE = Path(__file__).parents[4] / "docs" / "library.md"


def rows(title: str) -> list[list[str]]:
    section = PAGE.read_text().split(f"\n## {title}\n")[1].split("\n## ")[0]
    return [line.strip("|").split("|") for line in section.splitlines() if line.startswith("|")][2:]


def test_the_names_of_the_tasks_exist() -> None:
    names = {name for row in rows("Tasks") for name in re.findall(r"`([^`]+)`", row[2])}
    assert len(names) > 20
    for name in names:
        value: object = df
        for part in name.split("."):
            value = getattr(value, part)
