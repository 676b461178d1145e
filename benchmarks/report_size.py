"""How long a report is: ``python -m benchmarks.report_size [DIRECTORY]`` prints pages, words and size of its files.

Without a directory `clamped_beam` is run. Words are those that a reader sees, of the HTML and of the PDF; what a button
unfolds is not counted. The limits are those of issue 37: ten pages, 2500 words, 900 kB.
"""

import re
import subprocess
import sys
import tempfile
from html import unescape
from pathlib import Path

from jointbayes import load_case, sample, write_report

MOST = {"pages": 10, "words": 2500, "kB of HTML": 900}
_UNSEEN = re.compile(r"<(script|style|details|svg|title)\b.*?</\1>", re.DOTALL)


def words_of(page: str) -> int:
    """Words of a page of HTML that are seen."""
    return len(unescape(re.sub(r"<[^>]+>", " ", _UNSEEN.sub(" ", page))).split())


def size_of(directory: Path) -> dict[str, int]:
    """Pages of the PDF, words and size of the HTML, of a run directory or a report."""
    page = (directory / "report.html").read_bytes()
    info = subprocess.run(["pdfinfo", directory / "report.pdf"], capture_output=True, check=True, text=True).stdout
    pages = int(re.search(r"Pages:\s+(\d+)", info)[1])  # type: ignore[index]
    return {"pages": pages, "words": words_of(page.decode()), "kB of HTML": -(-len(page) // 1000)}


def main() -> int:
    """Print the sizes, and exit 1 where one is beyond its limit."""
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(sys.argv[1]) if sys.argv[1:] else Path(folder)
        if not sys.argv[1:]:
            write_report(sample(load_case("configs/clamped_beam.toml"), seed=1), directory)
        sizes = size_of(directory)
    for name, size in sizes.items():
        print(f"{name}: {size} (at most {MOST[name]})")
    return int(any(size > MOST[name] for name, size in sizes.items()))


if __name__ == "__main__":
    sys.exit(main())
