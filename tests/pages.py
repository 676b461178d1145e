"""README and the pages of the documentation: their fences, and their text without these."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
README, DOCS = ROOT / "README.md", ROOT / "docs"
PAGES = sorted([README, *DOCS.rglob("*.md")])
_FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)


def text_of(page: Path | str) -> str:
    """Text of a page, or of the page of a name in docs."""
    return (DOCS / page).read_text(encoding="utf-8")


def fenced(page: Path | str, *kinds: str) -> list[str]:
    """What stands in the fences of these kinds, of a page or of its text."""
    return [block for kind, block in _FENCE.findall(page if isinstance(page, str) else text_of(page)) if kind in kinds]


def prose(page: Path | str) -> str:
    """Text of a page without what stands in fences."""
    return _FENCE.sub("", text_of(page))
