"""How much there is to know: `python -m benchmarks.size` prints code lines and files, room by room.

A code line has a token on it that is neither comment nor docstring. Modules and functions are counted as a reader sees
them, with their docstrings.
"""

import ast
import io
import tokenize
from collections import Counter
from functools import cache
from pathlib import Path

from benchmarks.page import table

ROOT = Path(__file__).resolve().parents[1]
_NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


@cache
def code_lines(source: str) -> int:
    """Number of lines of a module without blanks, comments and docstrings.

    Examples
    --------
    >>> code_lines('# why\\n\\ndef f():\\n    "What."\\n    return (\\n        1\\n    )\\n')
    4
    """
    documented: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                documented.update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - documented)


def sizes(top: Path) -> tuple[Counter[str], Counter[str]]:
    """Code lines and files of each room under a directory."""
    lines, files = Counter[str](), Counter[str]()
    for path in sorted(top.rglob("*.py")):
        room, *inside = path.relative_to(top).parts
        room = room if inside else "(top)"
        lines[room] += code_lines(path.read_text(encoding="utf-8"))
        files[room] += 1
    return lines, files


def longest_functions(top: Path, most: int = 100) -> list[str]:
    """Functions under a directory of more than so many lines without their docstrings: place, name and length."""
    long = []
    for path in sorted(top.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                begin = node.body[1 if ast.get_docstring(node) and len(node.body) > 1 else 0].lineno
                length = (node.end_lineno or begin) - begin + 1
                if length > most:
                    long.append(f"{path.relative_to(top)}:{node.lineno} {node.name} {length}")
    return long


def main() -> None:
    """Print the table."""
    for top in (*(ROOT / "src" / name for name in ("vibrecords", "jointbayes")), ROOT / "tests", ROOT / "benchmarks"):
        lines, files = sizes(top)
        rows = [(room, str(lines[room]), str(files[room])) for room in sorted(lines)]
        rows.append(("all", str(lines.total()), str(files.total())))
        print(f"\n{top.relative_to(ROOT)}\n")
        print("\n".join(table(("room", "code lines", "files"), rows)))


if __name__ == "__main__":
    main()
