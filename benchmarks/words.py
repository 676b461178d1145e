"""Words of README and of the pages of `docs/`, as `wc -w` counts them: `python -m benchmarks.words`."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def words() -> dict[str, int]:
    """Words by page, the longest first; examples are pages of their own and have their own length."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    counted = {page.name: len(page.read_text(encoding="utf-8").split()) for page in pages}
    return dict(sorted(counted.items(), key=lambda row: -row[1]))


if __name__ == "__main__":
    for name, count in words().items():
        print(f"{count:6} {name}")
    print(f"{sum(words().values()):6} all")
