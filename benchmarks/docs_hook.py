"""What mkdocs does beside reading pages (`hooks` in mkdocs.yml): it draws figures, and writes pages from the code."""

import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def on_files(files: Any, config: Any) -> Any:
    """Add the pages made from the code, every figure of `docs/examples/`, and that of the published tables."""
    from mkdocs.structure.files import File

    if str(ROOT) not in sys.path:  # mkdocs loads this file alone, and takes back what it does to the path meanwhile
        sys.path.insert(0, str(ROOT))
    from benchmarks import example_figures, gallery, reference_pages

    for name, page in reference_pages.PAGES.items():
        files.append(File.generated(config, name, content=page()))
    files.append(File.generated(config, gallery.FIGURE, content=gallery.drawn()))
    for name, text in example_figures.drawn().items():
        files.append(File.generated(config, f"examples/{name}", content=text))
    return files
