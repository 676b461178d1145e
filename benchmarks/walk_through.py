"""The walk-throughs of the documentation, each command run and its output written: `python -m benchmarks.walk_through`.

A page is read from its top: the commands of a ``console`` block are run in an empty directory that holds the files of
`FILES`, and what they print takes the place of what stands there. The lines of a ``toml`` block with a comment
``answers`` before it take the place of the lines of the newest case that begin alike, those of one with ``added`` go to
its end. The beam behind the files is exact, without a mesh. `--files DIRECTORY` writes the files, for a reader who
wants to follow; pages that are named are written alone.
"""

import argparse
import re
import shlex
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy

from benchmarks.exact_beam import ExactBeam, circle
from benchmarks.numbers import ROOT, command
from benchmarks.written_files import write_records
from vibrecords.records import FrfRecord

PAGES = tuple(ROOT / "docs" / f"{name}.md" for name in ("tutorial", "my-file"))
TRUTH = ExactBeam(
    0.383, circle(0.025, 0.3), 2.1e11, 0.3, 7800.0, {1: 0.0, 6: 0.1915, 11: 0.383}, (5.05e9, 3.44e7, 1.52e6)
)
AVERAGES, COHERENCE = 10, 0.98
G, LBF = 9.80665, 4.4482216152605
#: Cards of a file that is shown begin with a dollar as well.
_PROMPT = r"^(?=\$ (?:jointbayes|cat) )"
#: Commands that take minutes: their output is compared by nobody but the next build.
_LONG = ("identify", "run", "export")


def exact_accelerance(lines: np.ndarray, output: str = "11:y", loss_factor: float = 0.02) -> np.ndarray:
    """Accelerance over a force at the tip without noise, shape (lines,)."""
    return -((2 * np.pi * lines) ** 2) * TRUTH.receptance(lines, (output,), ("11:y",), loss_factor=loss_factor)[:, 0, 0]


def accelerance(lines: np.ndarray, output: str = "11:y", seed: int = 1) -> np.ndarray:
    """The same with the noise that the averages of a coherence leave, shape (lines,)."""
    rng = np.random.default_rng(seed)
    exact = exact_accelerance(lines, output)
    sd = np.abs(exact) * np.sqrt((1 - COHERENCE) / COHERENCE / (AVERAGES - 1) / 2)
    return exact + sd * (rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size))


def hits(count: int = 10, rate: float = 5120.0, seconds: float = 0.8) -> list[tuple[np.ndarray, np.ndarray]]:
    """Force in N and acceleration in m/s² of hits at the tip: modes up to 15 kHz, sampled finely and then decimated."""
    fine = 8 * rate
    rng, modes = np.random.default_rng(4), TRUTH.modes(15e3)
    shape = modes.shapes[:, TRUTH.index(["11:y"])[0]]
    time = np.arange(round(fine * seconds)) / fine
    made = []
    for _ in range(count):
        start, width, peak = 0.02, 0.0006, rng.uniform(80, 160)
        pulse = peak * np.sin(np.pi * np.clip((time - start) / width, 0, 1))
        response = np.zeros(time.size)
        for omega, phi in zip(modes.omega, shape, strict=True):
            a, b = [[0, 1], [-(omega**2), -0.02 * omega]], [[0], [phi]]
            c, d = [[-phi * omega**2, -0.02 * phi * omega]], [[phi**2]]
            system = tuple(map(np.array, (a, b, c, d)))
            *discrete, _ = scipy.signal.cont2discrete(system, 1 / fine, method="foh")
            numerator, denominator = scipy.signal.ss2tf(*discrete)
            response += scipy.signal.lfilter(numerator[0], denominator, pulse)
        signals = (scipy.signal.decimate(signal, 8, ftype="fir") for signal in (pulse, response))
        noisy = [s + sd * rng.standard_normal(s.size) for s, sd in zip(signals, (0.01, 0.02), strict=True)]
        made.append((noisy[0], noisy[1]))
    return made


def write_frfs(path: Path, lines: np.ndarray, kind: str, outputs: tuple[tuple[str, str], ...]) -> None:
    """FRFs with coherence as an analyser writes them; label of the file and DOF of each response."""
    records = [
        FrfRecord(
            label,
            "Point:3:Z+",
            lines,
            accelerance(lines, dof, seed),
            "accelerance",
            "(m/s^2)/N",
            np.full(lines.size, COHERENCE),
            AVERAGES,
        )
        for seed, (label, dof) in enumerate(outputs, 1)
    ]
    write_records(records, path, kind)


def write_lvm(path: Path) -> None:
    """Ten hits as LabVIEW writes them: a segment for each, force in lbf and acceleration in g."""
    made = hits()
    head = ["LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tOne"]
    text = [*head, "***End_of_Header***\t", ""]
    for force, response in made:
        text += ["Channels\t2", f"Samples\t{force.size}\t{force.size}", "Y_Unit_Label\tlbf\tg"]
        text += ["X_Dimension\tTime\tTime", "X0\t0\t0", f"Delta_X\t{1 / 5120.0!r}\t{1 / 5120.0!r}"]
        text += ["***End_of_Header***\t\t", "X_Value\thammer\tacc tip\tComment"]
        rows = zip((force / LBF).tolist(), (response / G).tolist(), strict=True)
        text += [f"{i / 5120.0!r}\t{x!r}\t{y!r}" for i, (x, y) in enumerate(rows)] + [""]
    path.write_text("\n".join(text), encoding="utf-8")


def write_csv(path: Path) -> None:
    """The FRF at the tip as a table, without coherence: each mode below 20 kHz damped by 1 %, noise of 2 % of |H|."""
    rng, lines, modes = np.random.default_rng(2), np.arange(20.0, 2400.0, 4.0), TRUTH.modes(2e4)
    omega, shape = modes.omega[:, None], modes.shapes[:, TRUTH.index(["11:y"])[0], None]
    stiff = omega**2 - (2 * np.pi * lines) ** 2
    damped = shape**2 * (1 / (stiff + 0.02j * omega * 2 * np.pi * lines) - 1 / stiff)
    exact = exact_accelerance(lines, loss_factor=0.0) - (2 * np.pi * lines) ** 2 * damped.sum(axis=0)
    noise = rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size)
    values = exact + 0.02 * np.abs(exact) / np.sqrt(2) * noise
    rows = (f"{f:g},{h.real:.6g},{h.imag:.6g}" for f, h in zip(lines, values, strict=True))
    path.write_text("\n".join(["Frequency (Hz),Real (m/s^2/N),Imaginary (m/s^2/N)", *rows]) + "\n", encoding="utf-8")


FILES: dict[str, Callable[[Path], None]] = {
    "tip.csv": write_csv,
    "tip.uff": lambda path: write_frfs(
        path, np.arange(20.0, 2400.0, 4.0), "uff58b", (("Point:3:Z+", "11:y"), ("Point:2:Z+", "6:y"))
    ),
    "hits.lvm": write_lvm,
}


def made(page: str, *, long: bool) -> str:
    """A page with what its commands print; without `long` that of commands which take minutes stays as it stands."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name, write in FILES.items():
            if name in page:
                write(folder / name)

        def replaced(block: re.Match[str]) -> str:
            if block["mark"]:
                newest = max(folder.glob("*.toml"), key=lambda path: path.stat().st_mtime_ns)
                (_answer if block["mark"] == "answers" else _add)(newest, block["body"])
                return block[0]
            return f"```console\n{_console(block['body'], folder, long)}```"

        return re.sub(
            r"(?:<!--(?P<mark>answers|added)-->\n)?```(?:console|toml)\n(?P<body>.*?)```",
            lambda b: replaced(b) if b["mark"] or b[0].startswith("```console") else b[0],
            page,
            flags=re.DOTALL,
        )


def _answer(case: Path, lines: str) -> None:
    text = case.read_text(encoding="utf-8")
    for line in lines.splitlines():
        start = line.split(" = ")[0]
        text, count = re.subn(rf"^{re.escape(start)} = .*$", lambda _, line=line: line, text, flags=re.MULTILINE)
        if count != 1:
            raise SystemExit(f"{case.name}: found {count} lines {start!r}; expected one")
    case.write_text(text, encoding="utf-8")


def _add(case: Path, lines: str) -> None:
    case.write_text(f"{case.read_text(encoding='utf-8')}\n{lines}", encoding="utf-8")


def _console(body: str, folder: Path, long: bool) -> str:
    out = []
    for part in re.split(_PROMPT, body, flags=re.MULTILINE):
        if not re.match(_PROMPT, part):
            continue
        line = part.splitlines()[0]
        name, *arguments = shlex.split(line[2:])
        if not long and (name != "jointbayes" or arguments[0] in _LONG):
            out.append(part)
            continue
        printed = (
            command(folder, *arguments)[1]
            if name == "jointbayes"
            else (folder / arguments[0]).read_text(encoding="utf-8").splitlines()
        )
        out.append("\n".join([line, *printed]) + "\n")
    return "".join(out)


def main() -> None:
    """Write the pages, or the files that they begin with."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=Path, help="directory to write the files of the walk-throughs into")
    parser.add_argument("--short", action="store_true", help="leave what commands that take long have printed")
    parser.add_argument("page", nargs="*", type=Path, default=PAGES, help="by default all walk-throughs")
    options = parser.parse_args()
    if options.files:
        for name, write in FILES.items():
            write(options.files / name)
        return
    for page in options.page:
        page.write_text(made(page.read_text(encoding="utf-8"), long=not options.short), encoding="utf-8")
        print(f"written: {page.name}")


if __name__ == "__main__":
    main()
