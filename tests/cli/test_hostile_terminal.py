"""Every command on a terminal, with names, titles, keys and labels that would steer it."""

import pytest

from tests.conftest import cheap_text, edited, first_in_ci
from tests.hostile import ON_TERMINAL, STEERING, TURN, on_terminal

pytestmark = pytest.mark.science

#: In a case file: as TOML escapes it; in a file's name nothing but a slash and a NUL is impossible.
IN_TOML = ON_TERMINAL.encode("unicode_escape").decode().replace("\\x", "\\u00").replace("\\u0007", "\\u0007")


IN_TABLE = f'"structure.{ON_TERMINAL}"'


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A directory with a case and a measurement whose names and texts are hostile."""
    place = tmp_path_factory.mktemp("terminal")
    titled = f'title = "{IN_TOML}"\n'
    text = cheap_text()
    line = next(line for line in text.splitlines() if line.startswith("title = "))
    case = edited(text, (line + "\n", titled), ("max_steps = 20000", "max_steps = 300"))
    (place / f"{ON_TERMINAL}.toml").write_text(case, encoding="utf-8")
    (place / "wrong.toml").write_text(f'{case}\n["{IN_TOML}"]\n"{IN_TOML}" = "{IN_TOML}"\n', encoding="utf-8")
    labels = f"frequency [Hz],real {ON_TERMINAL} / {TURN}f [m/N],imaginary"
    rows = "\n".join(f"{20 + i},1e-6,-1e-8" for i in range(60))
    (place / f"{ON_TERMINAL}.csv").write_text(f"{labels}\n{rows}\n", encoding="utf-8")
    table = f'key,serial,structure.length_mm,{IN_TABLE}\nA,"{ON_TERMINAL}",383,1\n'
    (place / f"{ON_TERMINAL}-bad.csv").write_text(table, encoding="utf-8")
    table = f'key,serial,structure.length_mm\nA,"{ON_TERMINAL}",383\n'
    (place / f"{ON_TERMINAL}-good.csv").write_text(table, encoding="utf-8")
    return place


CASE, TABLE = f"{ON_TERMINAL}.toml", f"{ON_TERMINAL}.csv"
COMMANDS = {
    "campaign": (
        ["campaign", f"{ON_TERMINAL}-good.csv", "--base", CASE, "--workers", "1", "--out", "many"],
        {0, 2, 3, 4},
    ),
    "a wrong campaign": (["campaign", f"{ON_TERMINAL}-bad.csv", "--base", CASE, "--out", "none"], {2}),
    "run": (["run", CASE, "--out", f"run{ON_TERMINAL}"], {0, 2, 3}),
    "sample": (["sample", CASE], {0, 3}),
    "report": (["report", f"{ON_TERMINAL}.nc", "--out", f"out{ON_TERMINAL}"], {0, 2, 3}),
    "identify": (["identify", CASE], {0}),
    "check": (["check", CASE], {0, 1, 2}),
    "compare": (["compare", CASE, "wrong.toml"], {2}),
    "plan": (["plan", CASE], {0, 2, 3}),
    "inspect": (["inspect", TABLE, "--figure", f"f{ON_TERMINAL}.svg"], {0, 2}),
    "init": (["init", f"new{ON_TERMINAL}.toml"], {0}),
    "a wrong case": (["run", "wrong.toml"], {2}),
    "no such case": (["run", f"no{ON_TERMINAL}"], {2}),
    "no such option": (["run", f"--{ON_TERMINAL}"], {2}),
    "no such command": ([ON_TERMINAL], {2}),
    "no such posterior": (["report", f"{ON_TERMINAL}x.nc"], {2}),
}


#: What prints what no other does, but for `plan`, which takes long: most errors come out at one place.
IN_CI = ("report", "inspect", "a wrong case", "no such option")


@pytest.mark.parametrize("name", first_in_ci([*IN_CI, *(name for name in COMMANDS if name not in IN_CI)], len(IN_CI)))
def test_no_name_steers_the_terminal(name, place):
    arguments, codes = COMMANDS[name]
    code, got = on_terminal(arguments, place)
    assert code in codes, got[-2000:].decode(errors="replace")
    assert b"Traceback" not in got
    for one in STEERING:
        assert one not in got, got[-2000:]
