"""Pictures of page one of reports, for docs/gallery.md: `python -m benchmarks.report_gallery [CASE …]`.

Each case is run by the command line as a user runs it; page one of its report.pdf becomes a small PNG in
``docs/figures/gallery/`` (pdftoppm of poppler draws it).
"""

import argparse
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

from benchmarks.numbers import CONFIGS, ROOT, command

FOLDER = ROOT / "docs" / "figures" / "gallery"
PAGE = ROOT / "docs" / "gallery.md"
COLOURS, WIDTH = 64, 760


def shown() -> dict[str, list[str]]:
    """The command that makes each picture of the page, by the name of the picture."""
    text = PAGE.read_text(encoding="utf-8")
    found = re.findall(r"^`jointbayes ([^`]+)`\n+!\[[^\]]*\]\(figures/gallery/(\w+)\.png\)", text, re.MULTILINE)
    return {name: arguments.split() for arguments, name in found}


def draw(name: str, arguments: list[str]) -> Path:
    """Run a command in an empty directory and draw page one of the report that it leaves."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "configs").symlink_to(CONFIGS)
        command(folder, *arguments)
        (report,) = folder.glob("reports/*/report.pdf")
        page = ["-png", "-r", "110", "-f", "1", "-l", "1", "-singlefile"]
        subprocess.run(["pdftoppm", *page, str(report), str(folder / "page")], check=True)
        return _shrink(folder / "page.png", FOLDER / f"{name}.png")


def _shrink(drawn: Path, target: Path) -> Path:
    """So few colours and pixels that a page of pictures stays small."""
    picture = Image.open(drawn).convert("RGB")
    picture = picture.resize((WIDTH, round(WIDTH * picture.height / picture.width)), Image.Resampling.LANCZOS)
    target.parent.mkdir(exist_ok=True)
    picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(target, optimize=True)
    return target


def main() -> None:
    """Draw the pictures that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", nargs="*", choices=[[], *shown()], help="by default all of the page")
    options = parser.parse_args()
    if shutil.which("pdftoppm") is None:
        raise SystemExit("pdftoppm: not found; expected poppler-utils; install it")
    for name in options.name or shown():
        path = draw(name, shown()[name])
        print(f"{path.relative_to(ROOT)}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
