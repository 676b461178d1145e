"""Figure and lines of docs/examples/spindle-tool.md: the lobes of examples/longer_tool.toml with the joints of a run.

python -m benchmarks.lobes
"""

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from click.testing import CliRunner

from benchmarks.record import write_between
from jointbayes.cli.commands import main as jointbayes

ROOT = Path(__file__).resolve().parents[1]
PAGE, FIGURE = ROOT / "docs" / "examples" / "spindle-tool.md", ROOT / "docs" / "figures" / "stability_lobes.svg"


def main() -> None:
    """Run the case, predict the longer tool, and write what the terminal prints of the lobes and their figure."""
    with TemporaryDirectory() as directory:
        run, there = Path(directory) / "run", Path(directory) / "there"
        for command in (
            ["run", str(ROOT / "configs" / "spindle_tool.toml"), "--out", str(run), "--quiet"],
            ["predict", str(run), str(ROOT / "examples" / "longer_tool.toml"), "--out", str(there), "--allow-outside"],
        ):
            ended = CliRunner().invoke(jointbayes, command, catch_exceptions=False)
            assert ended.exit_code == 0, ended.output
        shutil.copy(there / "figures" / "stability-lobes.svg", FIGURE)
        said = [line for line in ended.stdout.splitlines() if line.startswith(("mode 1:", "lobes:"))]
        write_between(PAGE, "lobes.py", "```text\n" + "\n".join(said) + "\n```")


if __name__ == "__main__":
    main()
