"""Every fault in a case file is one line that names file, line, key, expectation and remedy."""

import os
import re
import tomllib

import pydantic
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jointbayes.case.parse import parse_case
from jointbayes.case.spec.fields import Spec, listed
from jointbayes.case.spec.structure_tables import CircleSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import key_lines, read_text
from jointbayes.errors import CaseError
from tests.case.refusal_rows import case_text_named, lines_of, parts_named
from tests.conftest import CONFIGS, shipped_text
from tests.one_line import refused

GOOD = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
SIGNED = shipped_text("clamped_beam_frequencies")
#: With every optional table and, but for dof and the constants of other choices, every optional key.
FULL = case_text_named("every_key")

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
    return lines_of(caught.value)


@pytest.mark.parametrize(("text", "number", "key", "words"), HOPELESS.values(), ids=HOPELESS)
def test_text_that_is_no_case_is_one_line(text, number, key, words):
    (line,) = faults_of(text)
    assert line.startswith(f"case.toml:{number}: {key}: ")
    assert words in line


def test_several_faults_come_one_line_each_in_the_order_of_the_file():
    text = GOOD.replace("walkers = 48", "walkers = 1").replace("low = 1.0e4", "low = -1")
    text = text.replace("elements = 10", 'elements = "ten"').replace("length_mm = 383.0", "")
    numbers = [int(line.split(":")[1]) for line in faults_of(text)]
    assert (len(numbers), numbers) == (4, sorted(numbers))
    assert text.splitlines()[numbers[0] - 1].startswith("[structure]")
    assert text.splitlines()[numbers[3] - 1].startswith("walkers")


(TRICKY,) = parts_named("schema").values()


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

    for text in (GOOD, SIGNED, FULL, TRICKY, GOOD.replace("\n", "\r\n")):
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


FULL_KEYS = list(re.finditer(r"^(\w+) = ", FULL, re.MULTILINE))
FULL_HEADERS = list(re.finditer(r"^\[(?:\w+\.)?(\w+)\]", FULL, re.MULTILINE))


def check_never_another_exception(text, most):
    faults = []
    try:
        parse_case(text, "case.toml")
    except CaseError as error:
        faults = lines_of(error)
    assert len(faults) <= most


def test_deleting_any_key_of_the_fullest_case_is_a_valid_case_or_few_lines():
    for key in FULL_KEYS:
        # "scale" is what gives its two factors their meaning: both are named then
        most = 2 if key[1] == "scale" else 1
        check_never_another_exception(FULL[: key.start()] + FULL[FULL.index("\n", key.start()) :], most)


@pytest.mark.whole
@settings(deadline=None)
@given(st.sampled_from(FULL_KEYS + FULL_HEADERS), st.from_regex(r"[A-Za-z0-9_-]{1,12}", fullmatch=True))
def test_renaming_any_key_or_table_of_the_fullest_case_is_a_valid_case_or_few_lines(key, name):
    check_never_another_exception(FULL[: key.start(1)] + name + FULL[key.end(1) :], 2)


VALUES = st.one_of(
    st.integers().map(str),
    st.floats().map(repr),
    st.text(st.characters(codec="utf-8", exclude_characters="'\n\r"), max_size=30).map("'{}'".format),
    st.sampled_from(["true", "[]", "{}", "[[]]", "[1, 'a']", "{a = 1}", "12:30:00", "0x1F", "1e400"]),
)


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(FULL_KEYS), VALUES)
def test_no_value_of_any_key_of_the_fullest_case_causes_another_exception(key, value):
    check_never_another_exception(FULL[: key.end()] + value + FULL[FULL.index("\n", key.end()) :], 20)


@settings(deadline=None)
@given(st.text(max_size=60), st.integers(0, len(GOOD)))
def test_no_text_causes_another_exception(text, at):
    check_never_another_exception(GOOD[:at] + text + GOOD[at:], 1000)


def read_case_file(path):
    return parse_case(read_text(path), os.fspath(path))


def file_fault(path):
    return refused(lambda: read_text(path), CaseError, "expected a case file in TOML, UTF-8; ")


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


def test_special_files_and_impossible_names_are_one_line():
    assert "no regular file" in file_fault("/dev/null")
    assert re.search("no such file|cannot be read", file_fault("a\0b"))
    assert "no such file" in file_fault("two\nlines.toml")
    assert "cannot be read" in file_fault("x" * 5000)


def test_windows_line_ends_and_byte_order_mark_are_accepted(tmp_path):
    path = tmp_path / "case.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert parse_case(read_text(path)) == parse_case(GOOD)


def test_the_clamped_beam_is_the_one_of_the_paper():
    case = parse_case(GOOD)
    assert isinstance(case.structure.section, CircleSpec)
    lines = case.data.lines_hz()
    assert ((len(lines), lines[0], lines[-1]), case.structure.damping.ratio) == ((2481, 20.0, 2500.0), (0.01,))
    assert (case.joint.initial.k11, case.joint.initial.k12, case.joint.initial.k22) == (1e8, 0.0, 0.0)


@pytest.mark.parametrize("name", ["youngs_modulus", "density", "length", "section_size", "shear_coefficient"])
def test_natural_frequencies_may_come_from_an_uncertain_structure_with_noise_of_unknown_scale(name):
    case = parse_case(f'{SIGNED}\n[uncertain.{name}]\nsd_percent = 1.0\n[noise]\nscale = "sampled"\n')
    assert (list(case.uncertain.given), case.noise.scale) == ([name], "sampled")


def test_an_integer_is_accepted_where_a_number_is_meant():
    assert isinstance(parse_case(GOOD.replace("length_mm = 383.0", "length_mm = 383")).structure.length_mm, float)


# (20.9 - 20) / 0.3 is 2.9999999999999956 in floating point: the line at f_max_hz must not be lost.
@pytest.mark.parametrize(("top", "step", "count"), [(2500.0, 0.1, 24801), (2500.0, 7.0, 355), (20.9, 0.3, 4)])
def test_the_band_keeps_its_last_line(top, step, count):
    text = GOOD.replace("f_max_hz = 2500.0", f"f_max_hz = {top}").replace("f_step_hz = 1.0", f"f_step_hz = {step}")
    lines = parse_case(text).data.lines_hz()
    assert len(lines) == count
    assert lines[-1] <= top * (1 + 1e-12)


def test_models_are_frozen_and_check_what_python_code_builds():
    case = parse_case(GOOD)
    with pytest.raises(pydantic.ValidationError):
        case.title = "other"
    with pytest.raises(pydantic.ValidationError, match=r"prior\.k22"):
        CaseSpec.model_validate(case.model_dump() | {"prior": {"k22": 3}})


MODELS = [Spec]
for model in MODELS:
    MODELS += model.__subclasses__()
FIELDS = [(f"{model.__name__}.{key}", info) for model in MODELS for key, info in model.model_fields.items()]


def test_every_key_of_the_schema_says_what_it_expects():
    assert len(MODELS) > 20
    assert [key for key, info in FIELDS if not info.description] == []


#: How a description states a bound, by what pydantic calls it; and keys where it is that of entries or of characters.
BOUNDS = {"Gt": "greater than|above", "Ge": "at least|from", "Lt": "below", "Le": "at most|to"}
OF_ENTRIES = (
    r"PriorsSpec\..*|.*\.(title|axes|exclude_hz|bands_hz|masses_kg|numbers|nodes)|AboutSpec\..*|LeftOutSpec\.modes|"
    r"ModesSpec\.(frequencies_hz|damping_ratios)"
)


def test_every_number_is_bounded_as_its_description_says():
    assert len(FIELDS) > 200
    for key, info in FIELDS:
        found = re.findall(r"\b(Gt|Ge|Lt|Le)\(\w\w=([-\d.e+]+)\)", repr((info.metadata, info.annotation)))
        stated = [
            (bound, number)
            for bound, words in BOUNDS.items()
            for number in re.findall(rf"\b(?:{words}) (-?\d[\d.]*)", info.description)
        ]
        if not re.fullmatch(OF_ENTRIES, key):
            assert {(b, float(n)) for b, n in found} == {(b, float(n)) for b, n in stated}, key


# ---- many faults, and much of anything


@pytest.mark.parametrize(("added", "expected"), [
    ("[" + "a." * 20_000 + "a]\n", "case.toml:{line}: file: nested too deeply; expected a case file, no more than 20"),
    ("a." * 20_000 + "a = 1\n", "case.toml:{line}: file: nested too deeply"),
    ("a = " + "[" * 60 + "]" * 60 + "\n", "case.toml:1: file: nested too deeply"),
    ("a = " + "[" * 9000 + "]" * 9000 + "\n", "case.toml:1: file: nested too deeply"),
    ("a = " + "{a=" * 60 + "1" + "}" * 60 + "\n", "case.toml:1: file: nested too deeply"),
    ("".join(f"[{'a.' * n}b{n}]\n" for n in range(30)), "case.toml:{line}: file: nested too deeply"),
])  # fmt: skip
def test_a_file_of_many_levels_is_refused_before_it_takes_time(added, expected):
    (line,) = faults_of(f"{GOOD}\n{added}")
    assert line.startswith(expected.format(line=GOOD.count("\n") + (22 if "b29" in added else 2)))


def test_dots_in_texts_and_comments_are_no_levels():
    text = GOOD.replace('title = "', f'title = "{"a." * 40}') + f"# {'a.' * 40}\n"
    assert text != GOOD
    assert parse_case(text).title.startswith("a.a.")


@pytest.mark.parametrize("count", [3000, 60_000])
def test_a_list_of_thousands_of_dofs_is_one_line(count):
    labels = ", ".join(f'"{i + 1}:y"' for i in range(count))
    (line,) = faults_of(GOOD.replace('inputs = ["11:y"]', f"inputs = [{labels}]"))
    assert f"data.inputs: found a list of {count}; expected at most 2505 entries; shorten it" in line


@pytest.mark.parametrize("added", [
    "".join(f"[t{i}]\n" for i in range(4_010)), "".join(f"key{i} = 1\n" for i in range(4_010)),
    "".join(f"[structure.t{i}]\n" for i in range(4_010)),
])  # fmt: skip
def test_of_many_faults_the_first_are_told_and_the_others_counted(added):
    lines = faults_of(f"{GOOD}\n{added}")
    assert (len(lines), lines[-1]) == (21, "and 3990 more")
    numbers = [int(line.split(":")[1]) for line in lines[:-1]]
    assert numbers == sorted(numbers)


def test_an_unsorted_list_is_one_fault():
    numbers = ", ".join(str(30_000 - i) for i in range(20_000))
    band = GOOD[GOOD.index("f_min_hz") : GOOD.index("\n", GOOD.index("f_step_hz"))]
    (line,) = faults_of(GOOD.replace(band, f"frequencies_hz = [{numbers}]"))
    assert "found entry 2 = 29999.0 after 30000.0" in line


def test_more_values_than_memory_holds_are_refused_with_the_step():
    outputs = ", ".join(f'"{node}:y"' for node in range(1, 12)) + ', "2:rz", "3:rz"'
    text = GOOD.replace("f_step_hz = 1.0", "f_step_hz = 0.003").replace('outputs = ["11:y"]', f"outputs = [{outputs}]")
    (line,) = faults_of(text)
    assert "data.f_step_hz: 0.003 Hz makes 8.27e+05 lines in each of 13 FRFs; expected at most 10000000 values" in line


def test_of_many_names_a_message_lists_the_first_and_counts_the_rest():
    assert [listed(("a", "b", "c"), most) for most in (3, 2)] == ["a, b, c", "a, b and 1 more"]
