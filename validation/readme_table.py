"""Puts what a script found into README.md."""

import re
from pathlib import Path


def into_readme(text: str, name: str) -> None:
    """Replaces what stands between the marks `<!-- NAME -->` and `<!-- end of NAME -->`."""
    readme = Path(__file__).with_name("README.md")
    marks = rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end of {re.escape(name)} -->)"
    new, count = re.subn(marks, lambda m: f"{m[1]}\n{text}\n{m[2]}", readme.read_text(), flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f"{readme}: the marks of \"{name}\" are missing")
    readme.write_text(new)
