"""Cases that build on another file: what they become, where their faults are said to be, and what is refused."""

import tomllib
from pathlib import Path

import pytest

import jointbayes as jb
from jointbayes.case.case_text import case_text, read_case_text
from jointbayes.case.parse import parse_case
from tests.case.refusal_rows import parts_named
from tests.one_line import refused

BASE, TABLES, REFUSED = parts_named("case_text").values()


def write(directory: Path, **files: str) -> Path:
    for name, text in files.items():
        place = directory / f"{name.replace('__', '/')}.toml"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    return directory / "case.toml"


def test_tables_merge_key_by_key_and_lists_replace(tmp_path):
    case = write(
        tmp_path,
        base=BASE,
        case='extends = "base.toml"\n[structure]\ndamping.ratio = [0.03]\n[data]\noutputs = []\n'
        "[prior.k11]\nhigh = 2.0\n",
    )
    text = read_case_text(case)
    expected = tomllib.loads(BASE)
    expected["structure"]["damping"]["ratio"] = [0.03]
    expected["data"]["outputs"] = []
    expected["prior"]["k11"]["high"] = 2.0
    assert (text.data, tomllib.loads(text.text)) == (expected, expected)
    assert "extends" not in text.text
    assert text.text.startswith("# Merged from base.toml, case.toml\n")


def test_each_key_keeps_the_file_and_line_it_stands_in(tmp_path):
    case = write(tmp_path, base=BASE, case='extends = "base.toml"\n\n[data]\noutputs = ["1:y"]\n')
    text = read_case_text(case)
    own, base = str(case), str(tmp_path / "base.toml")
    assert (text.place(("structure", "length_mm")), text.place(("data", "outputs", 0))) == ((base, 4), (own, 4))
    assert text.place(("data", "outputs", 1)) == (own, 4)  # the second of the base is gone
    assert (text.place(("data", "file")), text.place(("data", "none"))) == ((base, 8), (own, 3))
    assert text.place(("prior", "k11", "none")) == (base, 11)


OTHERS = """
data = { kind = "measured_frf", file = "a.uff", low = 1 }
structure = { kind = "frame", damping = { law = "modal", ratio = 1 }, bodies = { nose = { side = 1 } } }
joint.dofs = ["1:y"]
joints.left.dofs = ["1:y"]
prior = { k11 = { distribution = "log_uniform", low = 2 }, k12.low = 3 }
"""


@pytest.mark.parametrize(("over", "changed"), [
    ('data = { kind = "measured_frf", file = "b.uff" }', {"data": {"kind": "measured_frf", "file": "b.uff", "low": 1}}),
    ('data.kind = "modes"', {"data": {"kind": "modes"}}),
    ('structure.damping = { law = "loss_factor" }', {
        "structure": {"kind": "frame", "damping": {"law": "loss_factor"}, "bodies": {"nose": {"side": 1}}}}),
    ('structure.kind = "beam"', {"structure": {"kind": "beam"}}),
    ('joint.kind = "coupled"', {"joint": {"dofs": ["1:y"], "kind": "coupled"}}),  # as it is where nothing is stated
    ('joint.kind = "springs"', {"joint": {"kind": "springs"}, "prior": None}),
    ('joint.parametrisation = "signed"\nprior.rho.low = -1', {
        "joint": {"dofs": ["1:y"], "parametrisation": "signed"}, "prior": {"rho": {"low": -1}}}),
    ('prior.k11 = { distribution = "normal" }', {"prior": {"k11": {"distribution": "normal"}, "k12": {"low": 3}}}),
    ('joints.left.kind = "springs"', {"joints": {"left": {"kind": "springs"}}}),
    ('bodies.nose.file = "n.uff"', {"bodies": {"nose": {"file": "n.uff"}}, "structure": {
        "kind": "frame", "damping": {"law": "modal", "ratio": 1}, "bodies": {}}}),
])  # fmt: skip
def test_a_table_of_another_kind_replaces_that_of_the_base(tmp_path, over, changed):
    case = write(tmp_path, base=OTHERS, case=f'extends = "base.toml"\n{over}\n')
    text = read_case_text(case)
    wanted = {key: table for key, table in {**tomllib.loads(OTHERS), **changed}.items() if table is not None}
    assert text.data == wanted
    for path in text.places:  # what is gone stands nowhere
        table = wanted
        for key in path:
            table = table[key]


def test_a_chain_is_laid_over_from_its_end(tmp_path):
    case = write(
        tmp_path,
        base=BASE,
        parts__middle='extends = "../base.toml"\ntitle = "Middle"\n[data]\nfile = ["a.uff", "../b.uff"]\n',
        case='extends = "parts/middle.toml"\n[structure]\nlength_mm = 1.0\n',
    )
    data = read_case_text(case).data
    assert (data["title"], data["structure"]["length_mm"]) == ("Middle", 1.0)
    assert data["data"]["file"] == ["parts/a.uff", "b.uff"]  # relative to the file that names them


def test_a_text_without_extends_is_itself():
    text = case_text(BASE, "x.toml")
    assert (text.text, text.place(("structure", "length_mm"))) == (BASE, ("x.toml", 4))


@pytest.mark.parametrize("line", REFUSED.splitlines())
def test_what_cannot_be_built_on_is_refused_in_one_line_with_file_and_key(tmp_path, line):
    case, base, words = line.replace("\\n", "\n").replace("$BASE", BASE).split(" ;; ")
    path = write(tmp_path / "here", case=case, **({"base": base} if base else {}))
    refused(lambda: read_case_text(path), jb.CaseError, words)


def test_a_base_outside_is_read_if_that_is_allowed(tmp_path):
    case = write(tmp_path / "here", case='extends = "../base.toml"\n')
    (tmp_path / "base.toml").write_text(BASE)
    assert read_case_text(case, allow_outside=True).data["data"]["file"] == "../tip.uff"


def test_every_file_that_a_base_elsewhere_names_is_found_from_the_case(tmp_path):
    """Matrices and bodies too, and those of tests; what only looks like a name of a file stays."""
    data = read_case_text(write(tmp_path, sub__base=TABLES, case='extends = "sub/base.toml"\n')).data
    assert (data["structure"]["stiffness"], data["structure"]["mass"]) == ("sub/K.npy", [[1.0]])
    assert data["structure"]["damping"] == {"law": "matrix", "damping_matrix": "sub/C.csv"}
    assert data["data"] == {"file": ["sub/a.uff", "b.uff"], "channels": {"file": "1:y"}}
    assert data["bodies"]["spindle"]["file"] == "sub/nose.uff"
    assert data["tests"]["hot"] == {"structure": {"mass": "sub/M.npy"}, "bodies": {"file": {"file": "sub/c.uff"}}}


def test_a_text_alone_builds_on_no_file():
    with pytest.raises(jb.CaseError, match=r"x\.toml:1: extends: found a text that is no file"):
        parse_case('extends = "base.toml"\n', "x.toml")


def test_faults_and_warnings_name_the_file_and_line_they_come_from(tmp_path, configs):
    whole = (configs / "clamped_beam.toml").read_text()
    line = next(i for i, row in enumerate(whole.splitlines(), 1) if row.startswith("length_mm = 383.0"))
    base = whole.replace("length_mm = 383.0", 'length_mm = "383"')
    case = write(tmp_path, base=base, case='extends = "base.toml"\n[structure]\nlenght_mm = 390.0\n')
    with pytest.raises(jb.CaseError) as refused:
        jb.load_case(case)
    own, other = str(refused.value).splitlines()
    assert own.startswith(f"{case}:3: structure.lenght_mm: unknown key")
    assert other.startswith(f"{tmp_path / 'base.toml'}:{line}: structure.length_mm: found the text")
    write(tmp_path, base=whole.replace("length_mm = 383.0", "length_mm = 0.383"), case='extends = "base.toml"\n')
    (warning, *_) = jb.load_case(case).warnings
    assert (warning.file, warning.line) == (str(tmp_path / "base.toml"), line)
