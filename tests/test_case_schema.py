"""Every fault in a case file is one line that names file, line, key, expectation and remedy."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pydantic
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jointbayes import case_schema
from jointbayes.case_schema import CaseSpec, CircleSpec, parse_case, read_case_file
from jointbayes.errors import CaseError
from jointbayes.toml_text import key_lines

CONFIGS = Path(__file__).parents[1] / "configs"
GOOD = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
SIGNED = (CONFIGS / "clamped_beam_frequencies.toml").read_text(encoding="utf-8")
ONE_LINE = re.compile(r"case\.toml:[1-9]\d*: [^\n]+?: [^\n]+; expected [^\n]+; [^\n]+")
JARGON = re.compile(r"input should|valid (number|integer|string)|literal|pydantic|type=|discriminator|NoneType")

# One broken file in each row: changes to the good file (old=>new && old=>new) ;; key ;; words of the message.
# The fault must be reported on the line of the change, or, if a change holds an @, on the line of the @.
BROKEN = r"""
title = =># && # The clamped=>@# The clamped ;; title ;; add title =
title = "C=>title = "\\nC ;; title ;; a text of one line
"beam"  =>"beem"   ;; structure.kind ;; did you mean "beam"?
against = []=>against = {} ;; joint.against ;; found a table
length_mm = 383.0=>length_mm = 0.0 ;; structure.length_mm ;; length of the beam in mm, a number greater than 0
length_mm = 383.0=>length_mm = "383" ;; structure.length_mm ;; without quotes: length_mm = 383
length_mm = 383.0=>length_mm = nan ;; structure.length_mm ;; found nan
length_mm = 383.0=>length_mm = inf ;; structure.length_mm ;; found inf
length_mm = 383.0=>length_mm = true ;; structure.length_mm ;; found true
length_mm = 383.0=>length_mm = 1e400 ;; structure.length_mm ;; found inf
length_mm = 383.0=>length_mm = 2015-07-01 ;; structure.length_mm ;; found a date
length_mm = 383.0=> && [structure]=>@[structure] ;; structure.length_mm ;; add length_mm = 383.0 to [structure]
length_mm=>lenght_mm ;; structure.lenght_mm ;; did you mean "length_mm"?
length_mm=>"a b\\n" = 1\nlength_mm ;; structure."a b\\n" ;; unknown key
diameter_mm=>density_kg_m3 = 1.0\ndiameter_mm ;; structure.section.density_kg_m3 ;; belongs in [structure]
supports=>suports ;; structure.suports ;; did you mean "supports"?
[structure.section]=>[structure.secton] ;; structure.secton ;; did you mean "section"?
[structure.section]=>[strcture.section] ;; strcture ;; did you mean "structure"? rename it
[structure.section]=>[[structure.section]] ;; structure.section ;; single brackets
elements = 10=>elements = 0 ;; structure.elements ;; a whole number from 1 to 2000
elements = 10=>elements = 2001 ;; structure.elements ;; from 1 to 2000
elements = 10=>elements = 10.0 ;; structure.elements ;; without a decimal point: elements = 10
dofs_per_node = 2=>dofs_per_node = 3 ;; structure.dofs_per_node ;; 2 (y, rz) or 5
gpa = 210.0=>gpa = -210.0 ;; structure.youngs_modulus_gpa ;; in GPa
ratio = 0.3=>ratio = 0.5 ;; structure.poissons_ratio ;; below 0.5
ratio = 0.3=>ratio = -1 ;; structure.poissons_ratio ;; above -1
kg_m3 = 7800.0=>kg_m3 = 0 ;; structure.density_kg_m3 ;; in kg/m³
"cowper"=>"cowpr" ;; structure.shear_coefficient ;; did you mean "cowper"?
"cowper"=>1.01 ;; structure.shear_coefficient ;; at most 1
supports = []=>supports = [ # held\n"2:y",\n@"3y" ] ;; structure.supports ;; did you mean "3:y"?
supports = []=>supports = ["0:y"] ;; structure.supports ;; counted from 1
supports = []=>supports = ["02:y"] ;; structure.supports ;; did you mean "2:y"?
supports = []=>supports = ["12:y"] ;; structure.supports ;; a node from 1 to 11
supports = []=>supports = ["2:z"] ;; structure.supports ;; dofs_per_node = 5
supports = []=>supports = ["2:y", "2:y"] ;; structure.supports ;; listed twice
"circle" =>"cirle"  ;; structure.section.shape ;; did you mean "circle"?
shape = =># && [structure.section]=>@[structure.section] ;; structure.section.shape ;; "tube"
shape = =>shpe =  ;; structure.section.shpe ;; did you mean "shape"?
diameter_mm = 25.0=>diameter_mm = 0 ;; structure.section.diameter_mm ;; the diameter in mm
diameter_mm=>width_mm ;; structure.section.width_mm ;; with shape = "rectangle"
"circle" =>"tube" # && diameter_mm=>outer_diameter_mm = 25.0\n@inner_diameter_mm ;; structure.section.inner_diameter_mm ;; no wall
"circle" =>"rectangle" # && diameter_mm=>width_mm = 9\n@height_mm = 0 # ;; structure.section.height_mm ;; along y) in mm
"circle" =>"box" # && diameter_mm=>width_mm = 9\nheight_mm = 5\n@wall_mm = 2.5 # ;; structure.section.wall_mm ;; below 2.5 mm
"modal" =>"model"  ;; structure.damping.law ;; did you mean "modal"?
ratio = 0.01=>ratio = 1.0 ;; structure.damping.ratio ;; below 1
ratio = 0.01=>ratio = [\n0.01, # 1 %\n@-0.02] ;; structure.damping.ratio ;; as entry 2
ratio = 0.01=>ratio = [] ;; structure.damping.ratio ;; an empty list
"modal" =>"loss_factor" # && ratio = 0.01=>loss_factor = -0.1 ;; structure.damping.loss_factor ;; at least 0
"modal" =>"rayleigh" # && ratio = 0.01=>alpha_per_s = 1.0\n@beta_s = -1.0 ;; structure.damping.beta_s ;; in s
"1:y", "1:rz"] =>"1:y"]  ;; joint.dofs ;; two DOF labels
"1:y", "1:rz"] =>"1:y", "1:y"]  ;; joint.dofs ;; listed twice
"1:y", "1:rz"] =>"1:rz", "1:y"]  ;; joint.dofs ;; no translation
"1:y", "1:rz"] =>"1:y", "99:rz"]  ;; joint.dofs ;; no node 99
supports = []=>supports = ["1:rz"] && dofs = =>@dofs =  ;; joint.dofs ;; held fixed
against = []=>against = ["2:y"] ;; joint.against ;; no DOF (joint to ground) or two
against = []=>against = ["1:y", "2:rz"] ;; joint.against ;; at another node
_node = 2=>_node = 5 && against = []=>against = ["2:z", "2:rz"] ;; joint.against ;; direction of joint.dofs, y
against = []=>against = ["12:y", "2:rz"] ;; joint.against ;; no node 12
= "log"=>= "lgo" ;; joint.parametrisation ;; did you mean "log"?
[joint.initial]=>[joint.inital] ;; joint.inital ;; did you mean "initial"?
k11 = 1.0e8=>k11 = -1.0e8 ;; joint.initial.k11 ;; in N/m
k12 = 0.0=>k12 = 1.0 ;; joint.initial.k12 ;; not positive semidefinite
[prior.k12]=>[prior.k12x] ;; prior.k12x ;; did you mean "k12"?
= "log"=>= "signed" && [prior.k12]=>@[prior.k12] ;; prior.k12 ;; replace it by rho
[prior.k11]=>[prior.rho]\ndistribution="uniform"\nlow=0\nhigh=1\n[prior.k11] ;; prior.rho ;; there is no rho
"log_uniform" #=>"loguniform" # ;; prior.k11.distribution ;; did you mean "log_uniform"?
low = 1.0e6=>low = 0.0 ;; prior.k11.low ;; N/m
high = 1.0e11=>high = 1.0e6 ;; prior.k11.high ;; not above low
"log_uniform" #=>"log_normal"\nmedian = 1e9\n@sd_log = 0 # && low = 1.0e6\nhigh = 1.0e11=> ;; prior.k11.sd_log ;; greater than 0
"log_uniform" #=>"decades"\nguess = 1e9\n@decades = 0 # && low = 1.0e6\nhigh = 1.0e11=> ;; prior.k11.decades ;; 95 %
"synthetic_frf"=>"synthetic" ;; data.kind ;; did you mean "synthetic_frf"?
kind = "synthetic_frf"=> && [data]=>@[data] ;; data.kind ;; "natural_frequencies"
outputs = ["11:y"]=>outputs = [] ;; data.outputs ;; at least one
outputs = ["11:y"]=>outputs = ["11:y", "11:y"] ;; data.outputs ;; listed twice
outputs = ["11:y"]=>outputs = ["11:ry"] ;; data.outputs ;; no direction ry
inputs = ["11:y"]=>inputs = ["12:y"] ;; data.inputs ;; no node 12
= "receptance"=>= "receptence" ;; data.quantity ;; did you mean "receptance"?
f_min_hz = 20.0=>f_min_hz = 0 ;; data.f_min_hz ;; in Hz
f_min_hz = 20.0=> && [data]=>@[data] ;; data.f_min_hz ;; add f_min_hz = 20.0 to [data]
f_max_hz = 2500.0=>f_max_hz = 20.0 ;; data.f_max_hz ;; not above f_min_hz
f_step_hz = 1.0=>f_step_hz = 2481.0 ;; data.f_step_hz ;; empty band
f_step_hz = 1.0=>f_step_hz = 1.0e-300 ;; data.f_step_hz ;; at most 1000000 lines
f_min_hz = 20.0\nf_max_hz = 2500.0\nf_step_hz = 1.0=> && [data]=>@[data] ;; data ;; no frequencies
f_min_hz=>frequencies_hz = [1.0, 2.0]\nf_min_hz ;; data.frequencies_hz ;; not both
f_min_hz = 20.0\nf_max_hz = 2500.0\nf_step_hz = 1.0=>frequencies_hz = [1] ;; data.frequencies_hz ;; at least two
f_min_hz = 20.0\nf_max_hz = 2500.0\nf_step_hz = 1.0=>frequencies_hz = [3,\n@2] ;; data.frequencies_hz ;; after 3.0
k12 = 3.44e7=>k12 = 1.0e8 ;; data.truth.k12 ;; lower |k12| below 8.76128e+07 N
k12 = 3.44e7=>k12 = 1.0e300 ;; data.truth.k12 ;; exceeds k11·k22
relative = 0.03=>relative = -0.03 ;; data.noise.relative ;; at least 0
floor = 0.01=>floor = 0 && relative = 0.03=>@relative = 0.0 ;; data.noise.relative ;; both 0
seed = 20150787=>seed = -1 ;; data.noise.seed ;; a whole number from 0
added = true=>added = "yes" ;; data.noise.added ;; true
"measured"  =>"mesured"   ;; identification.sensitivity ;; did you mean "measured"?
max_steps = 30=>max_steps = 10001 ;; identification.max_steps ;; from 1 to 10000
threshold = 1.0e-10=>threshold = 0.0 ;; identification.threshold ;; greater than 0
seed = 1\n=>seed = 1.5\n ;; sampling.seed ;; a whole number
ensembles = 4=>ensembles = 3 ;; sampling.ensembles ;; from 4
walkers = 48=>walkers = 25 ;; sampling.walkers ;; an even number from 8
walkers = 48=>walkers = 6 ;; sampling.walkers ;; an even number from 8
walkers = 48=>processes = 0 ;; sampling.processes ;; a whole number from 1
max_steps = 20000=>max_steps = 199 ;; sampling.max_steps ;; from 200
source = =># && [reference]=>@[reference] ;; reference.source ;; add source
[120.0, 762.0, 2101.0]=>[120.0,\n@119.0] ;; reference.natural_frequencies_hz ;; after 120.0
paper_audit = true=>paper_audit = 1 ;; reference.paper_audit ;; true
length_mm = 383.0=>length_mm = 383,0 ;; length_mm ;; decimals with a point
elements = 10=>elements = 10\n@elements = 11 ;; elements ;; given twice
[joint]=>[structure] ;; syntax ;; given twice
length_mm = 383.0=>length_mm =  ;; length_mm ;; no value that TOML knows
"beam"=>"beam ;; kind ;; closing quote
"beam"=>beam ;; kind ;; no value that TOML knows
length_mm = 383.0=>length_mm 383.0 ;; syntax ;; equals sign
length_mm = 383.0=>length_mm = 0xyz ;; length_mm ;; expected TOML
"""  # noqa: E501
BROKEN_SIGNED = r"""
"uniform"=>"uniforn" ;; prior.rho.distribution ;; did you mean "uniform"?
low = -1.0=>low = -1.1 ;; prior.rho.low ;; from -1 to 1
high = 1.0\n=>high = -1.0\n ;; prior.rho.high ;; not above low
parametrisation = "signed"=># && [prior.rho]=>@[prior.rho] ;; prior.rho ;; replace it by k12
[prior.rho]=>[rho] ;; rho ;; unknown table
[120.0, 762.0, 2101.0]=>[] ;; data.frequencies_hz ;; in Hz
[120.0, 762.0, 2101.0]=>[120.0,\n762.0,\n@762.0] ;; data.frequencies_hz ;; after 762.0
s = 10=>s = 1 && supports = []=>supports = ["2:y", "2:rz"] && frequencies_hz =>@frequencies_hz  ;; data.frequencies_hz ;; for 2 free DOFs
sd_hz = 0.5=>sd_hz = 0 && sd_relative = 0.005=>@sd_relative = 0 ;; data.sd_relative ;; both 0
sd_hz = 0.5=>sd_hz = -0.5 ;; data.sd_hz ;; in Hz
"""  # noqa: E501
# Whole texts that are no case at all.
HOPELESS = {
    "empty": ("", 1, "file", "holds no key"),
    "comments only": ("# one\n\n# two\n", 1, "file", "holds no key"),
    "a null byte": ("title = 'a'\n\0", 2, "syntax", "neither a key nor a table"),
    "open multi-line text": ('title = 1\nx = """\nabc', 3, "syntax", "closing quote"),
    "5000 digits": ("title = 1\nx = 1" + 5000 * "0" + "\n\n", 2, "x", "more than 4300 digits"),
    "100 000 brackets": ("x = " + 100_000 * "[", 1, "file", "nested too deeply"),
    "key and table": ("a.b = 1\na.b.c = 2", 2, "a.b.c", "given twice"),
    "inline key twice": ("x = {a = 1, a = 2}", 1, "x", "given twice"),
}


def faults_of(text):
    with pytest.raises(CaseError) as caught:
        parse_case(text, "case.toml")
    lines = str(caught.value).split("\n")
    for line in lines:
        assert ONE_LINE.fullmatch(line), line
        assert line.isprintable(), line
        assert not JARGON.search(line), line
    return lines


def rows(table):
    decoded = (re.sub(r"(?<!\\)\\n", "\n", row) for row in table.strip().split("\n"))
    return [row.replace("\\\\", "\\").split(" ;; ") for row in decoded]


def break_file(text, changes):
    """Apply the changes of a row; return the text and the line that the fault must be reported on."""
    for change in changes.split(" && "):
        old, new = change.split("=>")
        assert old in text, f"{old!r} is not in the good file"
        text = text.replace(old, new if "@" in changes else f"@{new}", 1)
    mark = text.rindex("@")
    return text.replace("@", ""), text.count("\n", 0, mark) + 1


ROWS = [(GOOD, *row) for row in rows(BROKEN)] + [(SIGNED, *row) for row in rows(BROKEN_SIGNED)]


@pytest.mark.parametrize(("good", "changes", "key", "words"), ROWS, ids=[row[1][:40] for row in ROWS])
def test_each_broken_rule_is_one_line_with_file_line_and_key(good, changes, key, words):
    text, number = break_file(good, changes)
    (line,) = faults_of(text)
    assert line.startswith(f"case.toml:{number}: {key}: ")
    assert words in line


@pytest.mark.parametrize(("text", "number", "key", "words"), HOPELESS.values(), ids=HOPELESS)
def test_text_that_is_no_case_is_one_line(text, number, key, words):
    (line,) = faults_of(text)
    assert line.startswith(f"case.toml:{number}: {key}: ")
    assert words in line


def test_several_faults_come_one_line_each_in_the_order_of_the_file():
    text = GOOD.replace("walkers = 48", "walkers = 1").replace("low = 1.0e4", "low = -1")
    text = text.replace("elements = 10", 'elements = "ten"').replace("length_mm = 383.0", "")
    numbers = [int(line.split(":")[1]) for line in faults_of(text)]
    assert len(numbers) == 4
    assert numbers == sorted(numbers)
    assert text.splitlines()[numbers[0] - 1].startswith("[structure]")
    assert text.splitlines()[numbers[3] - 1].startswith("walkers")


TRICKY = """# a [comment] = 1
"top level" = 1
a.'b c'.d = 2
text = \"\"\"
[not] a = 'table'
\"\"\"  # "
[x . "y.z"]
list = [ # [
  1, "]", # ,
  [2,
   3], {in = 4}, '''
''', 5 ]
[[x.many]]
n = 1979-05-27 07:32:00
[[x.many]]
n = { p.q = 1, r = [
  { s = 1 }] }
[x.many.sub]
t = '#'
[x]
last = true
"""


def test_key_lines_survive_all_of_tomls_spellings():
    lines = key_lines(TRICKY)
    where = {path: TRICKY.splitlines()[line - 1].strip() for path, line in lines.items()}
    assert where["top level",].startswith('"top level"')
    assert where["a", "b c", "d"].startswith("a.'b c'.d")
    assert where["x", "y.z"].startswith("[x .")
    assert where["x", "y.z", "list", 1] == '1, "]", # ,'
    assert where["x", "y.z", "list", 2, 1].startswith("3]")
    assert where["x", "y.z", "list", 3, "in"].startswith("3]")
    assert where["x", "y.z", "list", 5].endswith("5 ]")
    assert lines["x", "many", 0, "n"] == lines["x", "many", 0] + 1
    assert where["x", "many", 1, "n", "p", "q"].startswith("n = { p.q")
    assert where["x", "many", 1, "n", "r", 0, "s"].startswith("{ s")
    assert where["x", "many", 1, "sub", "t"] == "t = '#'"
    assert where["x",] == "[x]"


def test_key_lines_know_exactly_the_paths_that_tomllib_finds():
    def paths(value, path=()):
        pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, inner in pairs:
            yield (*path, key)
            yield from paths(inner, (*path, key))

    for text in (GOOD, SIGNED, TRICKY, GOOD.replace("\n", "\r\n")):
        assert set(key_lines(text)) == set(paths(tomllib.loads(text)))


def test_dotted_keys_and_inline_tables_make_the_same_case():
    text = GOOD.replace("[structure.section]\nshape", "section.shape")
    text = text.replace("\ndiameter_mm", "\nsection.diameter_mm")
    text = re.sub(r"\[data.noise\][^\[]*", "", text)
    text = text.replace("[data]\n", "[data]\nnoise = {relative = 0.03, floor = 0.01, seed = 20150787}\n")
    assert parse_case(text) == parse_case(GOOD)
    (line,) = faults_of(text.replace("floor = 0.01", "flor = 0.01"))
    number = text.count("\n", 0, text.index("noise = ")) + 1
    assert line.startswith(f"case.toml:{number}: data.noise.flor: ")


KEYS = list(re.finditer(r"^(\w+) = ", GOOD, re.MULTILINE))
HEADERS = list(re.finditer(r"^\[(?:\w+\.)?(\w+)\]", GOOD, re.MULTILINE))


def check_never_another_exception(text, most):
    try:
        parse_case(text, "case.toml")
    except CaseError:
        assert len(faults_of(text)) <= most


@pytest.mark.parametrize("key", KEYS, ids=lambda key: f"{key[1]} at {key.start()}")
def test_deleting_any_key_is_a_valid_case_or_one_line(key):
    check_never_another_exception(GOOD[: key.start()] + GOOD[GOOD.index("\n", key.start()) :], 1)


@settings(deadline=None)
@given(st.sampled_from(KEYS + HEADERS), st.from_regex(r"[A-Za-z0-9_-]{1,12}", fullmatch=True))
def test_renaming_any_key_or_table_is_a_valid_case_or_one_line(key, name):
    check_never_another_exception(GOOD[: key.start(1)] + name + GOOD[key.end(1) :], 1)


VALUES = st.one_of(
    st.integers().map(str),
    st.floats().map(repr),
    st.text(st.characters(codec="utf-8", exclude_characters="'\n\r"), max_size=30).map("'{}'".format),
    st.sampled_from(["true", "[]", "{}", "[[]]", "[1, 'a']", "{a = 1}", "12:30:00", "0x1F", "1e400"]),
)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(KEYS), VALUES)
def test_no_value_of_any_key_causes_another_exception(key, value):
    check_never_another_exception(GOOD[: key.end()] + value + GOOD[GOOD.index("\n", key.end()) :], 20)


@settings(deadline=None)
@given(st.text(max_size=60), st.integers(0, len(GOOD)))
def test_no_text_causes_another_exception(text, at):
    check_never_another_exception(GOOD[:at] + text + GOOD[at:], 1000)


def file_fault(path):
    with pytest.raises(CaseError) as caught:
        read_case_file(path)
    message = str(caught.value)
    assert "\n" not in message
    assert "expected a case file in TOML, UTF-8; " in message
    return message


def test_a_missing_file_is_one_line_that_proposes_a_neighbour(tmp_path):
    (tmp_path / "clamped.toml").write_text(GOOD, encoding="utf-8")
    path = tmp_path / "clampt.toml"
    assert file_fault(path).startswith(f"{path}:1: file: no such file; ")
    assert 'did you mean "clamped.toml"?' in file_fault(str(path))
    assert "check the path" in file_fault(tmp_path / "none" / "x.toml")


def test_a_directory_is_one_line(tmp_path):
    assert f"{tmp_path}:1: file: this is a directory; " in file_fault(tmp_path)


def test_text_that_is_not_utf8_is_one_line_and_names_the_line(tmp_path):
    path = tmp_path / "latin.toml"
    path.write_bytes(b"# one\ntitle = 'Tr\xe4ger'\n")
    assert file_fault(path).startswith(f"{path}:2: file: not UTF-8 text; ")


def test_a_file_over_1_mb_is_one_line(tmp_path):
    path = tmp_path / "large.toml"
    path.write_bytes(GOOD.encode() + b"#" * 1_000_000)
    assert "larger than 1 MB" in file_fault(path)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such files")
def test_special_files_and_impossible_names_are_one_line():
    assert "no regular file" in file_fault("/dev/null")
    assert re.search("no such file|cannot be read", file_fault("a\0b"))
    assert "no such file" in file_fault("two\nlines.toml")
    assert "cannot be read" in file_fault("x" * 5000)


def test_windows_line_ends_and_byte_order_mark_are_accepted(tmp_path):
    path = tmp_path / "case.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert read_case_file(path) == parse_case(GOOD)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_config_of_the_repository_loads(path):
    case = read_case_file(path)
    assert "SYNTHETIC" in path.read_text(encoding="utf-8")
    assert case.structure.length_mm == (360.0 if "360mm" in path.stem else 383.0)
    assert case.reference is None or (case.reference.k11, case.reference.k22) == (5.05e9, 1.52e6)
    assert case.joint.dofs == ("1:y", "1:rz")


def test_the_clamped_beam_is_the_one_of_the_paper():
    case = parse_case(GOOD)
    assert isinstance(case.structure.section, CircleSpec)
    lines = case.data.lines_hz()
    assert (len(lines), lines[0], lines[-1]) == (2481, 20.0, 2500.0)
    assert case.structure.damping.ratio == (0.01,)
    assert (case.joint.initial.k11, case.joint.initial.k12, case.joint.initial.k22) == (1e8, 0.0, 0.0)
    assert case.reference.paper_audit


def test_optional_tables_have_the_documented_defaults():
    case = parse_case(GOOD[: GOOD.index("[identification]")])
    assert (case.identification.sensitivity, case.identification.max_steps) == ("measured", 30)
    sampling = case.sampling
    assert (sampling.seed, sampling.ensembles, sampling.walkers, sampling.max_steps) == (1, 4, 48, 20000)
    assert sampling.processes == 1
    assert case.reference is None


def test_an_integer_is_accepted_where_a_number_is_meant():
    length = parse_case(GOOD.replace("length_mm = 383.0", "length_mm = 383")).structure.length_mm
    assert isinstance(length, float)


# (20.9 - 20) / 0.3 is 2.9999999999999956 in floating point: the line at f_max_hz must not be lost.
@pytest.mark.parametrize(("top", "step", "count"), [(2500.0, 0.1, 24801), (2500.0, 7.0, 355), (20.9, 0.3, 4)])
def test_the_band_keeps_its_last_line(top, step, count):
    text = GOOD.replace("f_max_hz = 2500.0", f"f_max_hz = {top}").replace("f_step_hz = 1.0", f"f_step_hz = {step}")
    lines = parse_case(text).data.lines_hz()
    assert len(lines) == count
    assert lines[-1] <= top * (1 + 1e-12)


def test_a_list_of_frequencies_replaces_the_band():
    band = "f_min_hz = 20.0\nf_max_hz = 2500.0\nf_step_hz = 1.0 "
    data = parse_case(GOOD.replace(band, "frequencies_hz = [20, 30.5] #")).data
    assert data.lines_hz() == (20.0, 30.5)


def test_models_are_frozen_and_check_what_python_code_builds():
    case = parse_case(GOOD)
    with pytest.raises(pydantic.ValidationError):
        case.title = "other"
    with pytest.raises(pydantic.ValidationError, match=r"prior\.k22"):
        CaseSpec.model_validate(case.model_dump() | {"prior": {}})


def test_every_key_of_the_schema_says_what_it_expects():
    models = [getattr(case_schema, name) for name in case_schema.__all__ if name.endswith("Spec")]
    models = [model for model in models if isinstance(model, type)]
    assert len(models) > 20
    for model in models:
        for name, info in model.model_fields.items():
            assert info.description, f"{model.__name__}.{name}"


def test_importing_the_package_does_not_load_pydantic():
    code = "import sys, jointbayes; sys.exit('pydantic' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
