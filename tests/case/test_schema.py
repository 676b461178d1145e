"""Every fault in a case file is one line that names file, line, key, expectation and remedy."""

import os
import re
import sys
import tomllib
from unicodedata import category

import pydantic
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jointbayes.case.parse import parse_case
from jointbayes.case.spec.fields import Spec, listed
from jointbayes.case.spec.structure_table import CircleSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import key_lines, read_text
from jointbayes.errors import CaseError
from tests.conftest import CONFIGS, shipped_text

GOOD = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
SIGNED = shipped_text("clamped_beam_frequencies")
UNCERTAIN = shipped_text("clamped_beam_uncertain")
LOSS_FACTOR = shipped_text("clamped_beam_loss_factor")
# One case with every optional table and, but for dof and the constants of other choices, every optional key.
NOISE_LAW = "relative = 0.03\nfloor = 0.01\n"
FULL = (
    UNCERTAIN.replace("[structure.section]", "accelerometer_mass_g = 2.0\n\n[structure.section]")
    .replace(NOISE_LAW, "coherence = 0.98\naverages = 10\nfloor = 0.001\n")
    .replace(
        "\n[data.noise]",
        """youngs_modulus_gpa = 208.0
density_kg_m3 = 7850.0
length_mm = 380.0
accelerometer_mass_g = 2.5
gain = 1.02
damping_ratio = [0.02, 0.01]

[data.noise]""",
    )
    .replace(
        "[data]\n",
        """[uncertain.accelerometer_mass]
sd_percent = 5.0

[uncertain.gain]
sd_percent = 3.0

[noise]
residuals = "log_magnitude"
distribution = "gaussian"
scale = "sampled"
scale_low_factor = 0.2
scale_high_factor = 5.0

[compare]
hypotheses = ["springs", "full"]

[data]
""",
    )
    .replace(
        "max_measurements = 1\n",
        "averages_factor = 8.0\nf_max_hz = 5000.0\nadded_mass_g = 50.0\nmax_measurements = 2\n",
    )
)
ONE_LINE = re.compile(r"case\.toml:[1-9]\d*: [^\n]+?: [^\n]+; expected [^\n]+; [^\n]+")
JARGON = re.compile(r"input should|valid (number|integer|string)|literal|pydantic|type=|discriminator|NoneType")

# One broken file in each row: changes to the good file (old=>new && old=>new) ;; key ;; words of the message.
# The fault must be reported on the line of the change, or, if a change holds an @, on the line of the @.
BROKEN = r"""
diameter_mm = 25.0=>radius_mm = 12.5 ;; structure.section.radius_mm ;; write diameter_mm = 25, a diameter is twice the radius
diameter_mm = 25.0=>radius_m = 0.0125 ;; structure.section.radius_m ;; write diameter_mm = 25, a diameter is twice the radius
diameter_mm = 25.0=>radius = 12.5 ;; structure.section.radius ;; rename it and give twice its value in mm
density_kg_m3 = 7800.0=>density_g_cm3 = 7.8 ;; structure.density_g_cm3 ;; write density_kg_m3 = 7800, the value in kg/m³
density_kg_m3 = 7800.0=>rho = 7800.0 ;; structure.rho ;; rename it and give its value in kg/m³
youngs_modulus_gpa = 210.0=>youngs_modulus_mpa = 210000 ;; structure.youngs_modulus_mpa ;; write youngs_modulus_gpa = 210,
title = "C=>title = "C:\\Users\\x ;; title ;; a Windows path with / or in single quotes
dofs = =># && [joint]=>@[joint] ;; joint.dofs ;; add dofs = ["1:y", "1:rz"]
title = "C=>title = "\\nC ;; title ;; a text of one line
"beam"  =>"beem"   ;; structure.kind ;; did you mean "beam"?
against = []=>against = {} ;; joint.against ;; found a table
length_mm = 383.0=>length_mm = 0.0 ;; structure.length_mm ;; length of the beam in mm, a number greater than 0
length_mm = 383.0=>length_mm = "383" ;; structure.length_mm ;; without quotes: length_mm = 383
length_mm = 383.0=>length_mm = nan ;; structure.length_mm ;; found nan
length_mm = 383.0=>length_mm = inf ;; structure.length_mm ;; found inf
length_mm = 383.0=>length_mm = true ;; structure.length_mm ;; found true
length_mm = 383.0=> && [structure]=>@[structure] ;; structure.length_mm ;; add length_mm = 383.0 to [structure]
length_mm=>lenght_mm ;; structure.lenght_mm ;; did you mean "length_mm"?
length_mm=>"a b\\n" = 1\nlength_mm ;; structure."a b\\n" ;; unknown key
diameter_mm=>density_kg_m3 = 1.0\ndiameter_mm ;; structure.section.density_kg_m3 ;; belongs in [structure]
[structure.section]=>[strcture.section] ;; strcture ;; did you mean "structure"? rename it
[structure.section]=>[[structure.section]] ;; structure.section ;; single brackets
elements = 10=>elements = 0 ;; structure.elements ;; a whole number from 1 to 500
elements = 10=>elements = 501 ;; structure.elements ;; from 1 to 500
elements = 10=>elements = 10.0 ;; structure.elements ;; without a decimal point: elements = 10
dofs_per_node = 2=>dofs_per_node = 3 ;; structure.dofs_per_node ;; 2 (y, rz) or 5
ratio = 0.3=>ratio = 0.5 ;; structure.poissons_ratio ;; below 0.5
ratio = 0.3=>ratio = -1 ;; structure.poissons_ratio ;; above -1
"cowper"=>"cowpr" ;; structure.shear_coefficient ;; did you mean "cowper"?
"cowper"=>1.01 ;; structure.shear_coefficient ;; at most 1
supports = []=>supports = [ # held\n"2:y",\n@"3y" ] ;; structure.supports ;; did you mean "3:y"?
supports = []=>supports = ["0:y"] ;; structure.supports ;; counted from 1
supports = []=>supports = ["02:y"] ;; structure.supports ;; did you mean "2:y"?
supports = []=>supports = ["12:y"] ;; structure.supports ;; a node from 1 to 11
supports = []=>supports = ["2:z"] ;; structure.supports ;; dofs_per_node = 5
supports = []=>supports = ["2:y", "2:y"] ;; structure.supports ;; listed twice
shape = =># && [structure.section]=>@[structure.section] ;; structure.section.shape ;; "tube"
diameter_mm=>width_mm ;; structure.section.width_mm ;; with shape = "rectangle"
"circle" =>"tube" # && diameter_mm=>outer_diameter_mm = 25.0\n@inner_diameter_mm ;; structure.section.inner_diameter_mm ;; no wall
"circle" =>"box" # && diameter_mm=>width_mm = 9\nheight_mm = 5\n@wall_mm = 2.5 # ;; structure.section.wall_mm ;; below 2.5 mm
"modal" =>"hysteretic"  ;; structure.damping.law ;; did you mean "loss_factor"?
length_mm = 383.0=>length_mm = 383.0\n@zeta = 0.01 ;; structure.zeta ;; write ratio in [structure.damping] with law = "modal"
length_mm = 383.0=>length_mm = 383.0\n@eta = 0.01 ;; structure.eta ;; write loss_factor in [structure.damping] with law = "loss_factor"
[sampling]=>[uncertain.density]\nsd_percent = 1.0\n@mean = 7800.0\n[sampling] ;; uncertain.density.mean ;; remove it: the middle is that of density_kg_m3 in [structure]
[sampling]=>[uncertain.gain]\nsd_percent = 1.0\n@mean = 1.0\n[sampling] ;; uncertain.gain.mean ;; remove it: the middle is the nominal value
k11 = 5.05e9=>k11_n_per_m = 5.05e9 ;; data.truth.k11_n_per_m ;; did you mean "k11"? rename it
ratio = 0.01=>ratio = 1.0 ;; structure.damping.ratio ;; below 1
ratio = 0.01=>ratio = [\n0.01, # 1 %\n@-0.02] ;; structure.damping.ratio ;; as entry 2
ratio = 0.01=>ratio = [] ;; structure.damping.ratio ;; an empty list
"1:y", "1:rz"] =>"1:y"]  ;; joint.dofs ;; two DOF labels
"1:y", "1:rz"] =>"1:rz", "1:y"]  ;; joint.dofs ;; no translation
"1:y", "1:rz"] =>"1:y", "99:rz"]  ;; joint.dofs ;; no node 99
supports = []=>supports = ["1:rz"] && dofs = =>@dofs =  ;; joint.dofs ;; held fixed
against = []=>against = ["2:y"] ;; joint.against ;; as many on both sides, or none (ground)
against = []=>against = ["1:y", "2:rz"] ;; joint.against ;; found DOFs 1:y, 1:rz, 1:y, 2:rz; expected one or more, each once
_node = 2=>_node = 5 && against = []=>against = ["2:z", "2:rz"] ;; joint.against ;; the same direction on both sides, y
against = []=>against = ["12:y", "2:rz"] ;; joint.against ;; no node 12
k12 = 0.0=>k12 = 1.0 ;; joint.initial.k12 ;; a positive semidefinite matrix
= "log"=>= "signed" && [prior.k12]=>@[prior.k12] ;; prior.k12 ;; replace it by rho
= "log"=>= "elastic_centre" && [prior.k12]=>@[prior.k12] && [prior.k22]=>[prior.k22c] ;; prior.k12 ;; replace it by arm
= "log"=>= "elastic" ;; joint.parametrisation ;; did you mean "elastic_centre"?
[prior.k11]=>[prior.rho]\ndistribution="uniform"\nlow=0\nhigh=1\n[prior.k11] ;; prior.rho ;; there is no rho
high = 1.0e11=>high = 1.0e6 ;; prior.k11.high ;; found low 1e+06, high 1e+06
kind = "synthetic_frf"=> && [data]=>@[data] ;; data.kind ;; "natural_frequencies"
outputs = ["11:y"]=>outputs = [] ;; data.outputs ;; at least one
outputs = ["11:y"]=>outputs = ["11:ry"] ;; data.outputs ;; no direction ry
inputs = ["11:y"]=>inputs = ["12:y"] ;; data.inputs ;; no node 12
f_step_hz = 1.0=> && [data]=>@[data] ;; data.f_step_hz ;; add f_step_hz = 1.0 to [data]
f_max_hz = 2500.0=>f_max_hz = 20.0 ;; data.f_max_hz ;; not above f_min_hz
f_step_hz = 1.0=>f_step_hz = 2481.0 ;; data.f_step_hz ;; empty band
f_step_hz = 1.0=>f_step_hz = 1.0e-5 ;; data.f_step_hz ;; at most 1000000 lines
f_min_hz = 20.0\nf_max_hz = 2500.0\nf_step_hz = 1.0=> && [data]=>@[data] ;; data ;; no frequencies
f_min_hz=>frequencies_hz = [1.0, 2.0]\nf_min_hz ;; data.frequencies_hz ;; not both
f_min_hz = 20.0\nf_max_hz = 2500.0\nf_step_hz = 1.0=>frequencies_hz = [1] ;; data.frequencies_hz ;; at least two
f_min_hz = 20.0\nf_max_hz = 2500.0\nf_step_hz = 1.0=>frequencies_hz = [3,\n@2] ;; data.frequencies_hz ;; after 3.0
k12 = 3.44e7=>k12 = 1.0e8 ;; data.truth.k12 ;; lower |k12| to 8.76128e+07 N or less, or raise k11 or k22
k12 = 3.44e7=>k12 = 1.0e300 ;; data.truth.k12 ;; of a magnitude from 1e-12 to 1e15
floor = 0.01=>floor = 0 && relative = 0.03=>@relative = 0.0 ;; data.noise.relative ;; both 0
added = true=>added = "yes" ;; data.noise.added ;; true
seed = 1\n=>seed = 1.5\n ;; sampling.seed ;; a whole number
walkers = 48=>walkers = 25 ;; sampling.walkers ;; an even number from 8
walkers = 48=>walkers = 6 ;; sampling.walkers ;; an even number from 8
source = =># && [reference]=>@[reference] ;; reference.source ;; add source
[120.0, 762.0, 2101.0]=>[120.0,\n@119.0] ;; reference.natural_frequencies_hz ;; after 120.0
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
low = -1.0=>low = -1.1 ;; prior.rho.low ;; from -1 to 1
high = 1.0\n=>high = -1.0\n ;; prior.rho.high ;; found low -1, high -1
parametrisation = "signed"=># && [prior.rho]=>@[prior.rho] ;; prior.rho ;; replace it by k12
[prior.rho]=>[rho] ;; rho ;; unknown table
[120.0, 762.0, 2101.0]=>[] ;; data.frequencies_hz ;; in Hz
[120.0, 762.0, 2101.0]=>[120.0,\n762.0,\n@762.0] ;; data.frequencies_hz ;; after 762.0
s = 10=>s = 1 && supports = []=>supports = ["2:y", "2:rz"] && frequencies_hz =>@frequencies_hz  ;; data.frequencies_hz ;; for 2 free DOFs
sd_hz = 0.5=>sd_hz = 0 && sd_relative = 0.005=>@sd_relative = 0 ;; data.sd_relative ;; found standard deviations [0.0, 0.0, 0.0] Hz
sd_hz = 0.5=>sd_khz = 0.0005 ;; data.sd_khz ;; write sd_hz = 0.5, the value in Hz
"""  # noqa: E501
BROKEN_FULL = r"""
[uncertain.youngs_modulus]\nsd_percent=>[uncertain.youngs_modulus]\n@sd ;; uncertain.youngs_modulus.sd ;; did you mean "sd_percent"? rename it and give its value in percent
[uncertain.youngs_modulus]\nsd_percent=>[uncertain.youngs_modulus]\n@sd_gpa ;; uncertain.youngs_modulus.sd_gpa ;; give its value in percent
[uncertain.youngs_modulus]\nsd_percent=>[uncertain.youngs_modulus]\n@low ;; uncertain.youngs_modulus.low ;; did you mean "low_factor"? rename it and give its value as a factor
[uncertain.youngs_modulus]=>[uncertain.E] ;; uncertain.E ;; did you mean "youngs_modulus"?
_mass_g = 2.0=>_mass_g = 0.0 && [uncertain.accelerometer_mass]=>@[uncertain.accelerometer_mass] ;; uncertain.accelerometer_mass ;; which is 0
outputs = ["11:y"]=>outputs = ["11:rz"] && accelerometer_mass_g = 2.0=>@accelerometer_mass_g = 2.0 ;; structure.accelerometer_mass_g ;; rotations only
[uncertain.length]=>[uncertain.temperature] ;; uncertain.temperature ;; one of youngs_modulus, density, length
sd_percent = 0.5=>low_factor = 0.9 && [uncertain.length]=>@[uncertain.length] ;; uncertain.length.high_factor ;; add high_factor = 10.0
sd_percent = 0.5=>high_factor = 1.1 && [uncertain.length]=>@[uncertain.length] ;; uncertain.length.low_factor ;; add low_factor = 0.1
sd_percent = 0.5=> && [uncertain.length]=>@[uncertain.length] ;; uncertain.length ;; sd_percent, sd_mm, or low_factor and high_factor
sd_percent = 0.5=>low_factor = 0.9\nhigh_factor = 1.1\n@sd_percent = 0.5 ;; uncertain.length.sd_percent ;; not both
low_factor = 0.1=>low_factor = 1.0 && high_factor = 10.0=>@high_factor = 1.0 ;; uncertain.damping_ratio.high_factor ;; found low 1, high 1
high_factor = 10.0=>high_factor = 100.0 ;; uncertain.damping_ratio.high_factor ;; below 100
ratio = 0.01=>ratio = [0.01, 0.0] && [uncertain.damping_ratio]=>@[uncertain.damping_ratio] ;; uncertain.damping_ratio ;; a damping ratio is 0
[uncertain.gain]=>[uncertain.loss_factor] ;; uncertain.loss_factor ;; law = "loss_factor" with a loss factor above 0
distribution = "gaussian"=>distribution = "normal" ;; noise.distribution ;; "gaussian" or "student_t"
distribution = "gaussian"=>dof = 5.0 ;; noise.dof ;; which distribution = "gaussian" does not use
scale = "sampled"\nscale_low_factor = 0.2\n=>@scale_low_factor = 0.2\n && scale_high_factor = 5.0=> ;; noise.scale_low_factor ;; which scale = "known" does not use
scale = "sampled"\nscale_low_factor = 0.2\n=> && scale_high_factor = 5.0=>@scale_high_factor = 5.0 ;; noise.scale_high_factor ;; write scale so, or remove
scale_low_factor = 0.2=>scale_low_factor = 1 && scale_high_factor = 5.0=>@scale_high_factor = 1 ;; noise.scale_high_factor ;; not above scale_low_factor
scale = "sampled"=>scale = "sampled"\n@scale_dof = 3.0 ;; noise.scale_dof ;; which scale = "sampled" does not use
scale = "sampled"=>scale = "sampled"\n@scale_guess = 2.0 ;; noise.scale_guess ;; scale = "integrated"
length_mm = 380.0=>poissons_ratio = 0.3 ;; data.truth.poissons_ratio ;; belongs in [structure]
damping_ratio = [0.02, 0.01]=>damping_ratio = [0.02, 1.01] ;; data.truth.damping_ratio ;; as entry 2
coherence = 0.98=> && [data.noise]=>@[data.noise] ;; data.noise.coherence ;; add coherence
coherence = 0.98=>coherence = 0.98\n@relative = 0.03 ;; data.noise.relative ;; not both
averages = 10=> && [data.noise]=>@[data.noise] ;; data.noise.averages ;; add averages = 10
coherence = 0.98\naverages = 10\n=> && [data.noise]=>@[data.noise] ;; data.noise.relative ;; as a fraction of |H|
"springs", "full"]=>"full", "full"] ;; compare.hypotheses ;; each hypothesis once
["springs", "full"]=>[] ;; compare.hypotheses ;; a list of at least one
parameter = "k12"=>parameter = "rho" ;; plan.parameter ;; "k11", "k12" or "k22"
["1:y", "2:y"=>["1:y", "12:y" ;; plan.outputs ;; no node 12
averages_factor = 8.0=>inputs = ["3:z"] ;; plan.inputs ;; no direction z
supports = []=>supports = ["3:y"] && averages_factor = 8.0=>@inputs = ["3:y"] ;; plan.inputs ;; held fixed
f_max_hz = 5000.0=>f_max_hz = 2500.0 ;; plan.f_max_hz ;; does not widen the band up to 2500.0 Hz
f_min_hz = 10.0\nf_max_hz = 2500.0\nf_step_hz = 2.0=>frequencies_hz = [1, 2] && f_max_hz = 5000.0=>@f_max_hz = 5000.0 ;; plan.f_max_hz ;; no band to widen
"""  # noqa: E501
BROKEN_LOSS_FACTOR = r"""
[data]\n=>[uncertain.damping_ratio]\nsd_percent = 2\n[data]\n ;; uncertain.damping_ratio ;; structure.damping has law = "loss_factor"
[structure.damping]=>[structure.damping]\nlaw = "rayleigh"\nalpha_per_s = 0.0\nbeta_s = 1e-6 # && law = "loss_factor"=>#  && loss_factor = =>#  && [data]\n=>@[uncertain.loss_factor]\nsd_percent = 2\n[data]\n ;; uncertain.loss_factor ;; uncertain Rayleigh damping is not offered
[structure.damping]=>[structure.damping]\nlaw = "rayleigh"\nalpha_per_s = 0.0\nbeta_s = 1e-6 # && law = "loss_factor"=>#  && loss_factor = =>#  && [data]\n=>@[uncertain.damping_ratio]\nsd_percent = 2\n[data]\n ;; uncertain.damping_ratio ;; uncertain Rayleigh damping is not offered
loss_factor = 0.02=>loss_factor = 0 && [data]\n=>@[uncertain.loss_factor]\nsd_percent = 2\n[data]\n ;; uncertain.loss_factor ;; a loss factor is 0
[data.truth]=>[data.truth]\n@damping_ratio = 0.01 ;; data.truth.damping_ratio ;; law = "modal"
"""  # noqa: E501
# What natural frequencies give no meaning.
BROKEN_SIGNED += r"""
[structure.section]=>accelerometer_mass_g = 2.0\n[structure.section] ;; structure.accelerometer_mass_g ;; without measured DOFs
[data]\n=>[uncertain.damping_ratio]\nsd_percent = 2\n[data]\n ;; uncertain.damping_ratio ;; do not depend on the damping
[data]\n=>[uncertain.loss_factor]\nsd_percent = 2\n[data]\n ;; uncertain.loss_factor ;; do not depend on the damping
[data]\n=>[uncertain.accelerometer_mass]\nsd_percent = 2\n[data]\n ;; uncertain.accelerometer_mass ;; without measured DOFs
[data]\n=>[uncertain.gain]\nsd_percent = 2\n[data]\n ;; uncertain.gain ;; do not depend on the gain
[data]\n=>[noise]\n@residuals = "log_magnitude"\n[data]\n ;; noise.residuals ;; neither magnitude nor phase
[data]\n=>[noise]\n@distribution = "student_t"\n[data]\n ;; noise.distribution ;; FRFs only
[data]\n=>@[noise.discrepancy]\nlength_low_hz = 1\nlength_high_hz = 9\n[data]\n ;; noise.discrepancy ;; it was removed: use [uncertain.model_error]
[data]\n=>@[noise.model_error]\nfrequency_error = 0.01\n[data]\n ;; noise.model_error ;; it was removed: use [uncertain.model_error]
[data]\n=>@[uncertain.mode_frequencies]\nsd_percent = 3\n[data]\n ;; uncertain.mode_frequencies ;; it was removed: use [uncertain.model_error]
[sampling]\n=>[sampling]\n@processes = 2\n ;; sampling.processes ;; it was removed: delete it, a run is one process (campaign
[data]\n=>[plan]\n@averages_factor = 2.0\n[data]\n ;; plan.averages_factor ;; beside natural frequencies
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
    return lines_of(caught.value)


def lines_of(error):
    """The lines of an error, each of which says where, and is printable and plain."""
    lines = str(error).split("\n")
    for line in lines:
        assert ONE_LINE.fullmatch(line) or re.fullmatch(r"and \d+ more", lines[-1]), line
        # spaces of every width are shown as they are
        assert "".join(" " if category(sign) == "Zs" else sign for sign in line).isprintable(), line
        assert not JARGON.search(line), line
    return lines


def rows(table):
    decoded = (re.sub(r"(?<!\\)\\n", "\n", row) for row in table.split("\n") if row)
    return [row.replace("\\\\", "\\").split(" ;; ") for row in decoded]


def break_file(text, changes):
    """Apply the changes of a row; return the text and the line that the fault must be reported on."""
    for change in changes.split(" && "):
        old, new = change.split("=>")
        assert old in text, f"{old!r} is not in the good file"
        text = text.replace(old, new if "@" in changes else f"@{new}", 1)
    mark = text.rindex("@")
    return text.replace("@", ""), text.count("\n", 0, mark) + 1


TABLES = ((GOOD, BROKEN), (SIGNED, BROKEN_SIGNED), (FULL, BROKEN_FULL), (LOSS_FACTOR, BROKEN_LOSS_FACTOR))
ROWS = [(good, *row) for good, table in TABLES for row in rows(table)]


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
    with pytest.raises(CaseError) as caught:
        read_text(path)
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
    assert parse_case(read_text(path)) == parse_case(GOOD)


def test_the_clamped_beam_is_the_one_of_the_paper():
    case = parse_case(GOOD)
    assert isinstance(case.structure.section, CircleSpec)
    lines = case.data.lines_hz()
    assert (len(lines), lines[0], lines[-1]) == (2481, 20.0, 2500.0)
    assert case.structure.damping.ratio == (0.01,)
    assert (case.joint.initial.k11, case.joint.initial.k12, case.joint.initial.k22) == (1e8, 0.0, 0.0)


def test_student_t_with_the_factor_integrated_out_is_refused_with_the_reason():
    (line,) = faults_of(f'{GOOD}\n[noise]\ndistribution = "student_t"\nscale = "integrated"\n')
    assert ": noise.scale: " in line
    assert "the integral over the factor is Gaussian only" in line


@pytest.mark.parametrize("name", ["youngs_modulus", "density", "length", "section_size", "shear_coefficient"])
def test_natural_frequencies_may_come_from_an_uncertain_structure_with_noise_of_unknown_scale(name):
    text = f'{SIGNED}\n[uncertain.{name}]\nsd_percent = 1.0\n[noise]\nscale = "sampled"\n'
    case = parse_case(text)
    assert list(case.uncertain.given) == [name]
    assert case.noise.scale == "sampled"


def test_a_plan_without_lists_takes_the_translations_that_can_move_and_the_measured_inputs():
    case = parse_case(GOOD.replace("supports = []", 'supports = ["4:y"]').replace("elements = 10", "elements = 10 #"))
    assert case.plan_outputs == tuple(f"{node}:y" for node in (1, 2, 3, 5, 6, 7, 8, 9, 10, 11))
    assert case.plan_inputs == ("11:y",)
    chosen = parse_case(f'{GOOD}\n[plan]\noutputs = ["11:rz", "6:y"]\ninputs = ["6:y"]\n')
    assert (chosen.plan_outputs, chosen.plan_inputs) == (("11:rz", "6:y"), ("6:y",))


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


def test_models_are_frozen_and_check_what_python_code_builds():
    case = parse_case(GOOD)
    with pytest.raises(pydantic.ValidationError):
        case.title = "other"
    with pytest.raises(pydantic.ValidationError, match=r"prior\.k22"):
        CaseSpec.model_validate(case.model_dump() | {"prior": {}})


MODELS = [Spec]
for model in MODELS:
    MODELS += model.__subclasses__()
FIELDS = [(f"{model.__name__}.{key}", info) for model in MODELS for key, info in model.model_fields.items()]


def test_every_key_of_the_schema_says_what_it_expects():
    assert len(MODELS) > 20
    assert [key for key, info in FIELDS if not info.description] == []


#: How a description states a bound, by what pydantic calls it; and keys where the bound is that of entries.
BOUNDS = {"Gt": "greater than|above", "Ge": "at least|from", "Lt": "below", "Le": "at most|to"}
OF_ENTRIES = (
    r"PriorsSpec\..*|.*\.(title|axes|exclude_hz|bands_hz|masses_kg|numbers)|LeftOutSpec\.modes|"
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


@pytest.mark.parametrize(
    ("added", "expected"),
    [
        (
            "[" + "a." * 20_000 + "a]\n",
            "case.toml:{line}: file: nested too deeply; expected a case file, no more than 20",
        ),
        ("a." * 20_000 + "a = 1\n", "case.toml:{line}: file: nested too deeply"),
        ("a = " + "[" * 60 + "]" * 60 + "\n", "case.toml:1: file: nested too deeply"),
        ("a = " + "[" * 9000 + "]" * 9000 + "\n", "case.toml:1: file: nested too deeply"),
        ("a = " + "{a=" * 60 + "1" + "}" * 60 + "\n", "case.toml:1: file: nested too deeply"),
        ("".join(f"[{'a.' * n}b{n}]\n" for n in range(30)), "case.toml:{line}: file: nested too deeply"),
    ],
)
def test_a_file_of_many_levels_is_refused_before_it_takes_time(added, expected):
    (line,) = faults_of(f"{GOOD}\n{added}")
    number = GOOD.count("\n") + (22 if "b29" in added else 2)
    assert line.startswith(expected.format(line=number))


def test_dots_in_texts_and_comments_are_no_levels():
    text = GOOD.replace('title = "', f'title = "{"a." * 40}') + f"# {'a.' * 40}\n"
    assert text != GOOD
    assert parse_case(text).title.startswith("a.a.")


@pytest.mark.parametrize("count", [3000, 60_000])
def test_a_list_of_thousands_of_dofs_is_one_line(count):
    labels = ", ".join(f'"{i + 1}:y"' for i in range(count))
    (line,) = faults_of(GOOD.replace('inputs = ["11:y"]', f"inputs = [{labels}]"))
    assert f"data.inputs: found a list of {count}; expected at most 2505 entries; shorten it" in line


@pytest.mark.parametrize(
    "added",
    [
        "".join(f"[t{i}]\n" for i in range(4_010)),
        "".join(f"key{i} = 1\n" for i in range(4_010)),
        "".join(f"[structure.t{i}]\n" for i in range(4_010)),
    ],
)
def test_of_many_faults_the_first_are_told_and_the_others_counted(added):
    lines = faults_of(f"{GOOD}\n{added}")
    assert len(lines) == 21
    assert lines[-1] == "and 3990 more"
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
