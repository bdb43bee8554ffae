"""Writes the tables of the scripts into the pages of docs."""

import re
from pathlib import Path


def into_readme(text: str, name: str) -> None:
    """Replaces the text between the marks `<!-- NAME -->` and `<!-- end of NAME -->` in the one page that has them."""
    folder = Path(__file__).parent.with_name("docs")
    marks = rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end of {re.escape(name)} -->)"
    pages = [page for page in sorted(folder.glob("**/*.md")) if re.search(marks, page.read_text(), flags=re.DOTALL)]
    if len(pages) != 1:
        raise SystemExit(f"{folder}: {len(pages)} pages have the marks of \"{name}\"; exactly one must have them")
    new = re.sub(marks, lambda m: f"{m[1]}\n{text}\n{m[2]}", pages[0].read_text(), flags=re.DOTALL)
    pages[0].write_text(new)
