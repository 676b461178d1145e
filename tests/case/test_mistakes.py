"""Mistakes that an engineer makes in a case file: what each is told names the remedy, in lines that fit a terminal."""

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.cli.output import LONGEST, shortened
from tests.conftest import CONFIGS, edited, shipped_text

BEAM = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
UNCERTAIN = shipped_text("clamped_beam_uncertain")
FREQUENCIES = shipped_text("clamped_beam_frequencies")
VARIANCE = """
[data.variance]
source = "relative"
relative = 0.03
floor = 0.01
"""
MEASURED = f"""{BEAM[: BEAM.index("[data]")]}
[data]
kind = "measured_frf"
file = "tip.csv"
channels = {{ "output 1" = "11:y", "input 1" = "11:y" }}
{VARIANCE}"""
BOLTED = """
[structure]
kind = "frame"
directions = ["x", "y", "rz"]
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "rectangle", width_mm = 40.0, height_mm = 20.0 }
damping = { law = "modal", ratio = 0.01 }

[structure.bodies.rail]
points = { root = [0, 0, 0], b1 = [200, 0, 0], b2 = [260, 0, 0], end = [500, 0, 0] }

[structure.bodies.arm]
points = { b1 = [200, 0, 0], b2 = [260, 0, 0], tip = [600, 0, 0] }

[joints.bolt1]
kind = "springs"
dofs = ["arm.b1:x", "arm.b1:y", "arm.b1:rz"]
against = ["rail.b1:x", "rail.b1:y", "rail.b1:rz"]

[joints.bolt2]
kind = "springs"
dofs = ["arm.b2:x", "arm.b2:y", "arm.b2:rz"]
against = ["rail.b2:x", "rail.b2:y", "rail.b2:rz"]

[data]
kind = "synthetic_frf"
outputs = ["arm.tip:y"]
inputs = ["arm.tip:y"]
f_min_hz = 20.0
f_max_hz = 800.0
f_step_hz = 4.0
noise = { relative = 0.03, floor = 0.01, seed = 1 }

[data.truth.stiffness]
bolt1 = { kx = 1e8, ky = 2e8, krz = 1e4 }
bolt2 = { kx = 1e8, ky = 2e8, krz = 1e4 }
"""
CASES = {"beam": BEAM, "uncertain": UNCERTAIN, "frequencies": FREQUENCIES, "measured": MEASURED, "bolted": BOLTED}

# One mistake in each row: the case, changes (old=>new && old=>new), words of the first line that tell what to do, and
# how many lines are told if that is not one.
MISTAKES = r"""
beam :: length_mm=>lenght_mm :: did you mean "length_mm"? rename it
beam :: length_mm = 383.0=>length_m = 0.383 :: write length_mm = 383, the value in mm
beam :: length_mm = 383.0=>length_cm = 38.3 :: write length_mm = 383, the value in mm
beam :: length_mm = 383.0=>length = 383.0 :: did you mean "length_mm"? rename it and give its value in mm
beam :: length_mm = 383.0=>L = 383.0 :: did you mean "length_mm"? rename it and give its value in mm
beam :: length_mm = 383.0=>length_mm = 0.383 :: if it is in m, write length_mm = 383
beam :: length_mm = 383.0=>length_mm = "383" :: write the number without quotes: length_mm = 383
beam :: length_mm = 383.0=>length_mm = "383 mm" :: write the number without quotes: length_mm = 383
beam :: length_mm = 383.0=>length_mm = 383 mm :: decimals with a point, no unit
uncertain :: [uncertain.youngs_modulus]\nsd_percent = 2.0=>[uncertain.youngs_modulus]\nsd_percent = 2.0 % :: decimals with a point, no unit
uncertain :: [uncertain.youngs_modulus]\nsd_percent = 2.0=>[uncertain]\nyoungs_modulus = { sd_percent = 2.0 % } :: write no unit, and close with }
measured :: file = "tip.csv"=>file = "tip.csv"\nf_min_hz = 700.0 :: data.f_min_hz: tip.csv: columns 2 and 3: found no line above 700 Hz
measured :: file = "tip.csv"=>file = "tip.csv"\nf_max_hz = 10.0 :: data.f_max_hz: tip.csv: columns 2 and 3: found no line below 10 Hz
measured :: file = "tip.csv"=>file = "tip.csv"\nf_max_hz = 2500.0 :: data.f_max_hz: found 2500; expected at most 599, where the lines of the file end; lower it, or measure further
beam :: length_mm = 383.0=>length_mm = 383,0 :: decimals with a point
beam :: length_mm = 383.0=>length_mm = -383.0 :: write for example length_mm = 383.0
beam :: length_mm = 383.0=>length_mm = 25.0 && diameter_mm = 25.0=>diameter_mm = 383.0 :: if it is exchanged with diameter_mm, write length_mm = 383
beam :: diameter_mm = 25.0=>diameter_mm = 0.025 :: if it is in m, write diameter_mm = 25
beam :: diameter_mm = 25.0=>radius_mm = 12.5 :: write diameter_mm = 25, a diameter is twice the radius
beam :: diameter_mm = 25.0=>diameter = 25.0 :: did you mean "diameter_mm"? rename it
beam :: youngs_modulus_gpa = 210.0=>E = 210.0 :: did you mean "youngs_modulus_gpa"? rename it and give its value in GPa
beam :: youngs_modulus_gpa = 210.0=>youngs_modulus_gpa = 210e9 :: if it is in Pa, write youngs_modulus_gpa = 210
beam :: youngs_modulus_gpa = 210.0=>youngs_modulus_gpa = 210000.0 :: if it is in MPa, write youngs_modulus_gpa = 210
beam :: youngs_modulus_gpa = 210.0=>youngs_modulus_pa = 2.1e11 :: write youngs_modulus_gpa = 210, the value in GPa
beam :: youngs_modulus_gpa = 210.0=>youngs_modulus_gpa = 7800.0 && density_kg_m3 = 7800.0=>density_kg_m3 = 210.0 :: if it is exchanged with density_kg_m3, write youngs_modulus_gpa = 210
beam :: density_kg_m3 = 7800.0=>density_kg_m3 = 7.8 :: if it is in g/cm³, write density_kg_m3 = 7800
beam :: density_kg_m3 = 7800.0=>density_kg_m3 = 7.8e-9 :: if it is in t/mm³, write density_kg_m3 = 7800
beam :: density_kg_m3 = 7800.0=>rho = 7800.0 :: did you mean "density_kg_m3"? rename it and give its value in kg/m³
beam :: poissons_ratio = 0.3=>poissons_ratio = 30 :: write for example poissons_ratio = 0.3
beam :: [structure.section]=>[section] :: write [structure.section]
beam :: "circle"=>"rectangle" :: add width_mm = 40.0 to [structure.section] :: 3
beam :: "circle"=>"round" :: write for example shape = "circle"
beam :: [structure.damping]=>[damping] :: write [structure.damping]
beam :: ratio = 0.01=>ratio = 1 :: write for example ratio = 0.01
beam :: ratio = 0.01=>ratio = 0.5 :: if it is in per cent, write 0.005
beam :: ratio = 0.01=>ratio_percent = 1 :: write ratio = 0.01, the value as a fraction
beam :: ratio = 0.01=>loss_factor = 0.02 :: it belongs in [structure.damping] with law = "loss_factor"
beam :: law = "modal"=>law = "hysteretic" :: did you mean "loss_factor"?
beam :: length_mm = 383.0=>length_mm = 383.0\nzeta = 0.01 :: write ratio in [structure.damping] with law = "modal"
beam :: elements = 10=>elements = 10.0 :: write it without a decimal point: elements = 10
beam :: supports = []=>supports = ["2-y"] :: did you mean "2:y"?
beam :: supports = []=>supports = ["1:y"] :: choose another or free this one
beam :: "1:y", "1:rz"=>"1:Y", "1:RZ" :: did you mean "1:y"? :: 2
beam :: "1:y", "1:rz"=>"1:y", "1:thetaz" :: did you mean "1:rz"?
beam :: "1:y", "1:rz"=>"1:y", "1:ry" :: set structure.dofs_per_node = 5
beam :: "1:y", "1:rz"=>"1:y" :: write for example dofs = ["1:y", "1:rz"]
beam :: "1:y", "1:rz"=>"12:y", "12:rz" :: write for example "11:y" :: 2
beam :: dofs = ["1:y"=>dof = ["1:y" :: did you mean "dofs"? rename it
beam :: k12 = 0.0=>k12 = 1e9 :: lower |k12| to 0 N or less, or raise k11 or k22
beam :: [prior.k11]=>[prior.k33] :: rename it to prior.k11
beam :: high = 1.0e11=>high = 1.0 :: exchange or correct them
beam :: distribution = "log_uniform"=>distribution = "lognormal" :: did you mean "log_normal"?
beam :: kind = "synthetic_frf"=>kind = "measured" :: did you mean "measured_frf"?
beam :: outputs = ["11:y"]=>outputs = ["tip"] :: write for example "1:y"
beam :: outputs = ["11:y"]=>outputs = ["12:y"] :: write for example "11:y"
beam :: f_max_hz = 2500.0=>f_max_khz = 2.5 :: write f_max_hz = 2500, the value in Hz
beam :: f_max_hz = 2500.0=>f_max_hz = 20.0 && f_min_hz = 20.0=>f_min_hz = 2500.0 :: exchange or correct them
beam :: f_step_hz = 1.0=># :: add f_step_hz = 1.0 to [data]
beam :: relative = 0.03=>relative = 3 :: if it is in per cent, write 0.03
beam :: relative = 0.03=>percent = 3 :: write relative = 0.03, the value as a fraction
beam :: k22 = 1.52e6=># :: add k22 = 1000000.0 to [data.truth]
beam :: k11 = 5.05e9=>k11_n_per_mm = 5.05e6 :: write k11 = 5.05e+09, the value in SI units
beam :: k11 = 5.05e9=>kx = 5.05e9 :: name the stiffnesses of this joint
beam :: walkers = 48=>chains = 4 :: did you mean "ensembles"?
beam :: max_steps = 20000=>max_steps = 2e4 :: write it without a decimal point: max_steps = 20000
beam :: "circle"=>“circle” :: write straight quotes
beam :: added = true=>added = True :: write a number, true, false
beam :: elements = 10=>elements = 10\nelements = 10 :: remove one of the two
uncertain :: [uncertain.youngs_modulus]\nsd_percent = 2.0=>[uncertain.youngs_modulus]\nsd_percent = 0.02 :: if it is a fraction, write 2
uncertain :: [uncertain.youngs_modulus]\nsd_percent=>[uncertain.youngs_modulus]\nsd :: did you mean "sd_percent"? rename it and give its value in percent
uncertain :: [uncertain.youngs_modulus]\nsd_percent=>[uncertain.youngs_modulus]\nsd_gpa :: did you mean "sd_percent"? rename it and give its value in percent
uncertain :: [uncertain.youngs_modulus]=>[uncertain.E] :: did you mean "youngs_modulus"? rename it
uncertain :: [uncertain.youngs_modulus]\nsd_percent=>[uncertain.youngs_modulus]\nmean = 210.0\nsd_percent :: remove it: the middle is that of youngs_modulus_gpa in [structure]
frequencies :: [120.0, 762.0, 2101.0]=>[762.0, 120.0, 2101.0] :: sort the list, each value once
frequencies :: frequencies_hz=>frequencies :: did you mean "frequencies_hz"? rename it and give its value in Hz
frequencies :: sd_relative = 0.005=>sd_percent = 0.5 :: write sd_relative = 0.005, the value as a fraction
measured :: "tip.csv"=>"tipp.csv" :: did you mean "tip.csv"?
measured :: "tip.csv"=>"C:\Users\me\tip.csv" :: write a Windows path with / or in single quotes
measured :: "tip.csv"=>"../tip.csv" :: move the file there, or allow it: --allow-outside
measured :: "tip.csv"=>"photo.png" :: export the measurement in one of them
measured :: "tip.csv"=>"no_units.csv" :: write for example quantity = "accelerance" in [data]
measured :: "output 1"=>"Point:11:Y+" :: did you mean "output 1"?
measured :: , "input 1" = "11:y"=> :: map the other channel of output 1 as well
measured :: source = "relative"\nrelative = 0.03\nfloor = 0.01=>source = "coherence"\naverages = 10 :: write in [data.variance] source = "relative", relative = 0.02, floor = 0.01
measured :: [data.variance]\nsource = "relative"=>[data.noise] :: the noise of measured data is that of [data.variance]
measured :: file = "tip.csv"=>file = "tip.csv"\nquantity = "receptance" :: take quantity away from [data], or make sure that the file is wrong :: 2
bolted :: arm]\npoints = { b1 = [200, 0, 0], b2=>arm]\npoints = { b1 = [200, 11, 0], b2 :: offset_mm = [0, -11, 0]
bolted :: root = [0, 0, 0]=>root = [0, 0] :: write every number, also those that are 0
bolted :: [joints.bolt1]=>[joint.bolt1] :: one of several joints is a table [joints.bolt1]
bolted :: dofs = ["arm.b1:x"=>dofs = ["amr.b1:x" :: did you mean "arm.b1:x"?
bolted :: outputs = ["arm.tip:y"]=>outputs = ["tip:y"] :: did you mean "arm.tip:y"?
"""  # noqa: E501
ROWS = [tuple(part.strip() for part in f"{row} :: 1".split(" :: ")[:4]) for row in MISTAKES.strip().splitlines()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A directory with the files that the cases name, and with some that are named by mistake."""
    folder = tmp_path_factory.mktemp("mistakes")
    lines = np.arange(20.0, 600.0)
    squared = (2 * np.pi * lines) ** 2
    values = -squared / (1e5 * (1 + 0.02j) - 0.1 * squared)
    for name, unit in (("tip.csv", " (m/s²/N)"), ("no_units.csv", "")):
        rows = (f"{f:g},{h.real:.6g},{h.imag:.6g}" for f, h in zip(lines, values, strict=True))
        (folder / name).write_text(f"Frequency (Hz),Real{unit},Imaginary{unit}\n" + "\n".join(rows), encoding="utf-8")
    (folder / "photo.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    return folder


def told(folder, text):
    """What is said of a case: faults, or warnings where it has none."""
    (folder / "case.toml").write_text(text, encoding="utf-8")
    try:
        case = jb.load_case(folder / "case.toml")
    except jb.CaseError as error:
        return str(error).replace(f"{folder}/", "").splitlines(), True
    return [f"case.toml:{warning.line}: {warning}" for warning in case.warnings], False


@pytest.mark.parametrize("name", CASES)
def test_the_cases_have_no_fault_before_the_mistake(folder, name):
    assert told(folder, CASES[name]) == ([], False)


def test_there_are_as_many_mistakes_as_were_judged():
    assert len(ROWS) == len(set(ROWS)) == 91


@pytest.mark.whole
@pytest.mark.parametrize(("name", "changes", "remedy", "count"), ROWS, ids=[f"{row[0]}: {row[1]}" for row in ROWS])
def test_a_mistake_is_told_with_what_to_do(folder, name, changes, remedy, count):
    pairs = (change.split("=>") for change in changes.split(" && "))
    text = edited(CASES[name], *((old.replace("\\n", "\n"), new.replace("\\n", "\n")) for old, new in pairs))
    lines, is_fault = told(folder, text)
    assert remedy in lines[0], lines
    assert len(lines) == int(count), lines
    for line in lines:
        assert line.startswith("case.toml:")
        if is_fault:  # where it is and what to do stay where a line is shortened; a warning takes two lines
            short = shortened(f"jointbayes: {line}")
            assert len(short) <= LONGEST
            assert short.endswith(line.rpartition("; ")[2])
