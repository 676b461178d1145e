"""Cases that together state every number that a case file may hold, no two alike of one number."""

from dataclasses import dataclass

#: Dimensions of each shape of section in mm.
SHAPES = {
    "circle": {"diameter_mm": 25.0},
    "tube": {"outer_diameter_mm": 40.0, "inner_diameter_mm": 30.0},
    "rectangle": {"width_mm": 41.0, "height_mm": 23.0},
    "box": {"width_mm": 43.0, "height_mm": 27.0, "wall_mm": 2.9},
}
LAWS = (
    'law = "modal", ratio = [0.011, 0.013]',
    'law = "loss_factor", loss_factor = 0.017',
    'law = "rayleigh", alpha_per_s = 1.3, beta_s = 1.7e-6',
)
SHEAR = ("0.83", "[0.81, 0.79]")
QUANTITIES = ("youngs_modulus", "density", "length", "section_size", "shear_coefficient", "axial_force",
              "accelerometer_mass", "gain")  # fmt: skip
RECORDS = (
    'method = "impact", block_s = 1.3, pretrigger_s = 0.011, force_window_s = 0.005, exponential_end = 0.06, '
    "force_range_n = 510.0",
    'method = "shaker", block_s = 1.7, overlap = 0.55',
)


@dataclass(frozen=True)
class KeyCase:
    """A case file; `act` is a step of a run that uses its numbers, and `keys` what those begin with that are moved."""

    text: str
    act: str = ""
    keys: str = ""


def section(shape: str, scale: float) -> str:
    sizes = ", ".join(f"{key} = {value * scale:.5g}" for key, value in SHAPES[shape].items())
    return f'{{ shape = "{shape}", {sizes} }}'


def read(*dofs: str) -> str:
    channels = ", ".join(f'c{i} = {{ dof = "{dof}" }}' for i, dof in enumerate(dofs))
    return f"""
[data]
kind = "measured_frf"
file = ["data.uff"]
variance = {{ source = "coherence" }}
channels = {{ {channels} }}
"""


PAIR = """
[joint]
dofs = ["1:y", "1:rz"]
initial = { k11 = 2e8, k12 = 3e5, k22 = 4e6 }
[prior]
k11 = { distribution = "log_uniform", low = 1.1e4, high = 1.3e11 }
k12 = { distribution = "log_normal", median = 1.7e5, sd_log = 2.3 }
k22 = { distribution = "decades", guess = 1.9e6, decades = 2.1 }
"""


def beam(number: int, more: str = 'element = "paper"') -> str:
    return f"""
[structure]
kind = "beam"
length_mm = 759.0
elements = 7
youngs_modulus_gpa = 211.0
poissons_ratio = 0.29
density_kg_m3 = 7830.0
shear_coefficient = 0.86
axial_force_n = 3100.0
accelerometer_mass_g = 3.1
section = {section(list(SHAPES)[number], 1.0)}
damping = {{ {LAWS[number % 3]} }}
{more}
"""


def uncertain(form: str, *names: str) -> str:
    return "".join(f"[uncertain.{name}]\n{form}\n" for name in names)


SD, ENDS = "sd_percent = 2.5", "low_factor = 0.4\nhigh_factor = 3.5"
#: What is uncertain of a beam, with modal damping and with a loss factor, by a standard deviation and between ends.
UNCERTAIN = [
    beam(law) + PAIR + read("8:y") + uncertain(form, *quantities, ratio) + length
    for law, ratio in enumerate(("damping_ratio", "loss_factor"))
    for form, quantities, length in (
        (SD, QUANTITIES, "[uncertain.length_offset]\nsd_mm = 1.9\n"),
        (ENDS, QUANTITIES, "[uncertain.length_offset]\nlow_mm = -5.5\nhigh_mm = 4.5\n"),
        (SD, [q for q in QUANTITIES if q != "length"], "[uncertain.length]\nsd_mm = 0.05\n"),
    )
]


def material(shift: int) -> str:
    return f"youngs_modulus_gpa = {201 + shift}.0\npoissons_ratio = 0.{21 + shift}\ndensity_kg_m3 = {7801 + shift}.0"


def body(number: int, shift: int) -> str:
    """Two members, of which the first states everything that it may, and a mass."""
    shape = list(SHAPES)[number]
    own = ", ".join(material(shift).splitlines())
    return f"""
points = {{ a = [1.0, 2.0, 3.0], b = [401.0, 12.0, 33.0], c = [505.0, 302.0, 43.0] }}
members = [
  {{ points = ["a", "b"], {own}, shear_coefficient = {SHEAR[number % 2]}, axial_force_n = 1300.0, up = [0.1, 0.9, 0.2],
     section = {section(shape, 1.1)}, end_section = {section(shape, 0.9)},
     offsets_mm = [[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]] }},
  {{ points = ["b", "c"] }},
]
masses = [{{ point = "c", mass_kg = 0.21, inertia_kg_m2 = [1e-4, 2e-4, 2.5e-4, 1e-6, 2e-6, 3e-6],
            offset_mm = [7.0, 8.0, 9.0] }}]
""".replace("\n     ", " ").replace("\n            ", " ")


def frame(number: int) -> str:
    return f"""
[structure]
kind = "frame"
{material(0)}
shear_coefficient = {SHEAR[number % 2].replace("8", "7")}
axial_force_n = 1100.0
accelerometer_mass_g = 3.1
element = "paper"
section = {section(list(SHAPES)[number], 1.0)}
damping = {{ {LAWS[number % 3]} }}
"""


FRAMES = [frame(i) + body(i, 1) + PAIR.replace("1:", "a:") + read("c:y") for i in range(4)]
BODIES = [
    frame(i)
    + f"[structure.bodies.tool]\n{material(2)}\nshear_coefficient = {SHEAR[i % 2].replace('8', '6')}\n"
    + "axial_force_n = 1200.0\n"
    + f"section = {section(list(SHAPES)[i], 1.2)}\n{body(i, 1)}"
    + "[structure.bodies.rest]\npoints = { p = [1.5, 2.5, 3.5], q = [11.0, 602.0, 13.0] }\n"
    + PAIR.replace("1:", "tool.a:")
    + read("tool.c:y")
    for i in range(4)
]
OF_BODIES = [
    frame(0)
    + "[structure.bodies.tool]\npoints = { a = [0, 0, 0], b = [300.0, 0, 400.0] }\n"
    + "[structure.bodies.rest]\npoints = { p = [0, 0, 0], q = [0, 602.0, 0] }\n"
    + PAIR.replace("1:", "tool.a:").replace("initial", 'against = ["rest.p:y", "rest.p:rz"]\ninitial')
    + read("tool.b:y")
    + uncertain(form, *(f"bodies.tool.{name}" for name in QUANTITIES[:6] if name != "length"))
    + uncertain(length, "bodies.tool.length")
    for form, length in ((SD, SD), (ENDS, ENDS), (SD, "sd_mm = 0.2"))
]
CHAINS = [
    f"""
[structure]
kind = "chain"
masses_kg = {{ a = 1.1, b = 2.2, c = 3.3 }}
springs = [{{ between = ["a", "b"], stiffness_n_per_m = 1.1e5 }},
           {{ between = ["c", "ground"], stiffness_n_per_m = 2.3e5 }}]
accelerometer_mass_g = 3.1
damping = {{ {law} }}
[joint]
kind = "springs"
dofs = ["a:x"]
against = ["c:x"]
[prior]
kx = {{ distribution = "uniform", low = 1.1e3, high = 1.3e6 }}
""".replace("\n           ", " ")
    + read("b:x")
    for law in (
        *LAWS,
        'law = "dampers", dampers = [{ between = ["a", "ground"], damping_n_s_per_m = 5.1 }, '
        '{ between = ["b", "c"], damping_n_s_per_m = 7.1 }]',
    )
]
ROWS, DIAGONAL = "[[{0}1e2, 3e1, 1.1e1], [3e1, {0}2e2, 1.3e1], [1.1e1, 1.3e1, {0}3e2]]", "[{0}4e2, {0}5e2, {0}6e2]"
MATRICES = [
    f"""
[structure]
kind = "matrices"
dofs = ["1:y", "1:rz", "2:y"]
stiffness = {one.format(7)}
mass = {other.format(9)}
points = {{ 1 = [1.0, 2.0, 3.0], 2 = [4.0, 5.0, 6.0] }}
accelerometer_mass_g = 3.1
damping = {{ {law} }}
"""
    + PAIR
    + read("2:y")
    for law, one, other in (
        (LAWS[0], ROWS, DIAGONAL),
        (LAWS[1], DIAGONAL, ROWS),
        (LAWS[2], ROWS, ROWS),
        (f'law = "matrix", damping_matrix = {ROWS.format(3)}', ROWS, ROWS),
        (f'law = "matrix", damping_matrix = {DIAGONAL.format(5)}', ROWS, ROWS),
    )
]
SIX = ("x", "y", "z", "rx", "ry", "rz")
TWO_POINTS = f"""
[structure]
kind = "matrices"
dofs = {[f"{point}:{way}" for point in (1, 2) for way in SIX]}
stiffness = {[2e5 + i for i in range(12)]}
mass = {[2.0 + i for i in range(12)]}
damping = {{ {LAWS[0]} }}
""" + read("2:y")
PLACED = f"""
kind = "springs"
dofs = {[f"1:{way}" for way in SIX]}
against = {[f"2:{way}" for way in SIX]}
axes = [[0.526540785, -0.593747647, 0.60845586], [0.627506872, 0.754301309, 0.193040571],
        [-0.573576436, 0.2801665, 0.769751131]]
offset_mm = [1.5, 2.5, 3.5]
offset_against_mm = [4.5, 5.5, 6.5]
""".replace("\n        [", " [")
KINDS = (
    'distribution = "log_uniform", low = {0}e4, high = {0}e8',
    'distribution = "log_normal", median = {0}e5, sd_log = 2.{1}',
    'distribution = "decades", guess = {0}e6, decades = 1.{1}',
    'distribution = "uniform", low = {0}e2, high = {0}e7',
    'distribution = "normal", mean = {0}e6, sd = {0}e5',
)


def spring_priors(table: str) -> str:
    kinds = [KINDS[i % 5].format(1.1 + i / 10, i + 1) for i in range(6)]
    return f"[{table}]\n" + "".join(f"k{way} = {{ {kind} }}\n" for way, kind in zip(SIX, kinds, strict=True))


RHO = '[{0}]\nk11 = {{ {1} }}\nk22 = {{ {2} }}\nrho = {{ distribution = "uniform", low = -0.9, high = 0.8 }}\n'
JOINTS = [
    TWO_POINTS + f"[joint]{PLACED}" + spring_priors("prior"),
    beam(0) + '[joint]\ndofs = ["1:y", "1:rz"]\nparametrisation = "signed"\n'
    + RHO.format("prior", KINDS[3].format(1.1, 1), KINDS[4].format(1.3, 1)) + read("8:y"),
    TWO_POINTS + f"[joints.left]{PLACED}" + spring_priors("joints.left.prior")
    + '[joints.right]\ndofs = ["2:y", "2:rz"]\nparametrisation = "signed"\n'
    + "initial = { k11 = 2e6, k12 = 3e3, k22 = 4e4 }\n"
    + RHO.format("joints.right.prior", KINDS[0].format(1.7, 1), KINDS[1].format(1.9, 1)),
]  # fmt: skip
VARIANCES = ("source = 'coherence', averages = 12", "source = 'relative', relative = 0.03, floor = 0.01")


def files(number: int) -> str:
    """What data of all kinds from files may say."""
    first = 'dof = "8:y", gain = 1.02, unit = "g", sensitivity = 0.011'
    return f"""
f_min_hz = 21.0
f_max_hz = 2400.0
thin = 3
exclude_hz = [[49.5, 50.7], [99.1, 102.3]]
channels = {{ a = {{ {first} }}, b = {{ dof = "-7:y", accelerometer_mass_g = 2.2 }} }}
variance = {{ {VARIANCES[number]} }}
records = {{ {RECORDS[number]} }}
"""


BARE = beam(0).replace("accelerometer_mass_g = 3.1\n", "") + PAIR
MEASURED = [
    BARE + f'[data]\nkind = "{kind}"\nfile = ["data.uff"]\n{files(i)}{more}'
    for i in range(2)
    for kind, more in (
        ("measured_frf",
         '[data.rotations."1:rz"]\nstations = ["1:y", "2:y"]\nspacing_mm = 110.0\n'
         '[data.rotations."8:rz"]\nstations = ["8:y", "7:y"]\nspacing_mm = 120.0\n'
         '[data.rotations."4:rz"]\nstations = ["3:y", "5:y"]\n'),
        ("measured_frequencies", "modes = 2\nsd_relative = 0.003\nsd_hz = 0.2\n"),
    )
]  # fmt: skip
SPINDLE = [
    BARE.replace("initial", 'against = ["s:y", "s:rz"]\ninitial') + read("8:y")
    + '[bodies.spindle]\nkind = "measured"\nfile = ["spindle.uff"]\n'
    + files(i).replace("8:y", "s:y").replace("7:", "r:")
    + '[bodies.spindle.rotations."s:rz"]\nstations = ["s:y", "r:y"]\nspacing_mm = 25.0\n'
    for i in range(2)
]  # fmt: skip
BAND = "f_min_hz = 20.0\nf_max_hz = 1000.0\nf_step_hz = 5.0"


def synthetic(lines: str = BAND, noise: str = "relative = 0.03, floor = 0.01", truth: str = "") -> str:
    return f"""
[data]
kind = "synthetic_frf"
outputs = ["8:y"]
inputs = ["8:y"]
{lines}
noise = {{ {noise}, seed = 5 }}
[data.truth]
{truth or "k11 = 5e8" + chr(10) + "k12 = 7e5" + chr(10) + "k22 = 9e5"}
"""


OTHERWISE = """
k11 = 5e8
k12 = 7e5
k22 = 9e5
youngs_modulus_gpa = 209.0
density_kg_m3 = 7790.0
length_mm = 751.0
accelerometer_mass_g = 2.9
gain = 1.03
damping_ratio = [0.012, 0.014]
"""
TIP = '[joint]\nkind = "springs"\ndofs = ["1:y", "1:rz"]\n[prior]\n' + "".join(
    f"{k} = {{ {KINDS[0].format(x, 1)} }}\n" for k, x in (("ky", 1.1), ("krz", 1.3))
)
FEET = "".join(
    f'[joints.{name}]\nkind = "springs"\ndofs = ["{at}:y", "{at}:rz"]\n[joints.{name}.prior]\n'
    + "".join(f"{k} = {{ {KINDS[0].format(x, 1)} }}\n" for k, x in (("ky", 1.1), ("krz", 1.3)))
    for name, at in (("left", 1), ("right", 8))
)
SYNTHETIC = [
    beam(0) + PAIR + synthetic(truth=OTHERWISE),
    beam(3) + PAIR + synthetic("frequencies_hz = [21.0, 45.0]", "coherence = 0.93, averages = 11, floor = 0.02"),
    beam(1) + TIP + synthetic(truth="stiffness = { ky = 5e7, krz = 6e4 }"),
    beam(1) + FEET
    + synthetic(truth="stiffness = { left = { ky = 5e7, krz = 6e4 }, right = { ky = 7e7, krz = 8e4 } }"),
]  # fmt: skip
NOISES = [
    "[noise]\ndistribution = 'student_t'\ndof = 5.5\n"
    "scale = 'sampled'\nscale_low_factor = 0.3\nscale_high_factor = 7.0",
    "[noise]\nscale = 'integrated'\nscale_dof = 4.4\nscale_guess = 1.2",
]
FREQUENCIES = [
    BARE + '[data]\nkind = "natural_frequencies"\nfrequencies_hz = [31.0, 210.0]\nsd_relative = 0.01\nsd_hz = 0.5\n'
]
MODES = [
    BARE + f"[data]\nkind = 'modes'\n{rows}\nnumbers = [1, 3]\nsd_relative = [0.011, 0.012]\n{more}"
    + uncertain(form, "youngs_modulus")
    for rows, more, form in (
        ("frequencies_hz = [[31.0, 210.0], [33.0, 212.0]]\nsd_hz = [0.3, 0.7]",
         "damping_ratios = [[0.011, 0.013], [0.012, 0.015]]\n"
         "damping_sd_relative = [0.1, 0.2]\ndamping_sd = [1e-3, 2e-3]\n"
         "[data.shapes]\ndofs = ['2:y', '3:y']\nreference = ['8:y']\nsd = [0.02, 0.03]\n"
         "components = [[[0.1, 0.2], [0.3, 0.4]], [[0.11, 0.21], [0.31, 0.41]]]\n"
         "[data.zeros]\ndof = '8:y'\nfrequencies_hz = [[32.0, 220.0], [34.0, 222.0]]\n"
         "sd_relative = [0.013, 0.014]\nsd_hz = [0.4, 0.8]\nnumbers = [1, 4]\n"
         "[data.constants]\noutputs = ['2:y']\ninputs = '8:y'\nvalues_per_kg = [[[0.5], [1.5]], [[0.6], [1.7]]]\n"
         "sd_relative = [0.05, 0.06]\nsd_per_kg = [0.01, 0.02]\n", SD),
        ("eigenvalues = [[5700.0, 2.1e5], [5800.0, 2.2e5]]\neigenvalue_sd = [60.0, 2000.0]", "", ENDS),
    )
]  # fmt: skip
MODEL_ERROR = """[uncertain.model_error]
frequency_error = 0.004
error_factor = 2.5
damping_error = 0.25
shape_error = 0.06
constant_error = 0.12
edge_error = 0.02
spring_error = 0.004
spring_factor = 8.0
"""
SETTINGS = """
[identification]
max_steps = 33
threshold = 1.1e-8
line_weight = 0.4
[sampling]
seed = 7
ensembles = 5
walkers = 52
max_steps = 21000
budget_s = 130
[reference]
source = "a table"
k11 = 1.5e9
k12 = 1.6e5
k22 = 1.7e6
natural_frequencies_hz = [31.0, 33.0]
[plan]
max_measurements = 2
averages_factor = 4.5
f_max_hz = 1500.0
added_mass_g = 51.0
"""
TESTS = {
    "frf": "averages = 13",
    "impact": "averages = 13\nblock_s = 0.5\nsample_rate_hz = 3000.0\nforce_noise = 0.0006\nresponse_noise = 0.0011\n"
    "exponential_end = 0.07\ndouble_hits = 1\noverloads = 2",
    "shaker": "block_s = 0.5\nsample_rate_hz = 3000.0\nforce_noise = 0.0006\nresponse_noise = 0.0011\noverlap = 0.3",
}
SEVERAL = beam(0) + PAIR + read("8:y") + """
[level]
name = "torque"
[tests.low]
level = 2.0
[tests.low.structure]
length_mm = 501.0
[tests.high]
level = 3.0
[tests.high.uncertain.density]
sd_percent = 1.1
"""  # fmt: skip
ASSEMBLIES = beam(0) + PAIR.replace("[joint]", "[joint]\nown = true") + read("8:y") + """
[assembly]
scatter = 0.12
scatter_factor = 2.7
[tests.first]
[tests.second]
"""  # fmt: skip
WHOLE = beam(0) + PAIR + synthetic()
CASES = [
    *map(KeyCase, (*UNCERTAIN[:2], *UNCERTAIN[3:5], *FRAMES, *BODIES, *CHAINS, *MATRICES, *SPINDLE)),
    *(KeyCase(beam(i) + PAIR + read("8:y")) for i in range(4)),
    KeyCase(UNCERTAIN[2], keys=r"uncertain\.length"),
    KeyCase(beam(0, "at_mm = { tip = 250.0 }") + PAIR + read("tip:y"), keys=r"structure.beam.\.at_mm"),
    *(KeyCase(text, keys="joint|prior") for text in JOINTS),
    *(KeyCase(text, keys=r"data|structure.beam.\.(length|elements)") for text in MEASURED),
    KeyCase(SYNTHETIC[0], keys="data"),
    *(KeyCase(text, keys="data|structure") for text in SYNTHETIC[1:]),
    *(KeyCase(text, keys="uncertain") for text in OF_BODIES),
    *(KeyCase(beam(0) + PAIR + read("8:y") + noise, keys="noise") for noise in NOISES),
    *(KeyCase(text.partition("[uncertain")[0], keys="data") for text in (*FREQUENCIES, MODES[0])),
    *(KeyCase(text, keys="data.modes.\\.eigen|uncertain") for text in MODES),
    KeyCase(FREQUENCIES[0] + MODEL_ERROR, keys="uncertain"),
    KeyCase(f"{MODES[0].partition('[uncertain')[0]}[left_out]\nmodes = [2]\n", keys="left_out"),
    KeyCase(f"{WHOLE}[left_out]\nbands_hz = [[110.0, 205.0], [410.0, 520.0]]\n", keys="left_out"),
    *(
        KeyCase(f"{made}[reference]\nsource = 'a table'\nstiffness = {stated}\n", keys="reference")
        for made, stated in (
            (SYNTHETIC[2], "{ ky = 5e7, krz = 6e4 }"),
            (SYNTHETIC[3], "{ left = { ky = 5e7, krz = 6e4 }, right = { ky = 7e7, krz = 8e4 } }"),
        )
    ),
    *(KeyCase(WHOLE + SETTINGS, act, keys) for act, keys in (("identify", "iden|samp|ref"), ("plan", "plan"))),
    *(
        KeyCase(f'{WHOLE}[virtual_test]\nmethod = "{name}"\nseed = 9\n{test}\n', "simulate", "virtual_test")
        for name, test in TESTS.items()
    ),
    KeyCase(SEVERAL, keys="tests"),
    KeyCase(ASSEMBLIES, keys="assembly"),
]
