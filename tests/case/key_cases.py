"""Cases that together state every number that a case file may hold, no two alike of one number."""

from dataclasses import dataclass
from string import Template

from tests.case.refusal_rows import parts_named

PARTS = parts_named("key_parts")
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
SD, ENDS = "sd_percent = 2.5", "low_factor = 0.4\nhigh_factor = 3.5"
ROWS, DIAGONAL = "[[{0}1e2, 3e1, 1.1e1], [3e1, {0}2e2, 1.3e1], [1.1e1, 1.3e1, {0}3e2]]", "[{0}4e2, {0}5e2, {0}6e2]"


@dataclass(frozen=True)
class KeyCase:
    """A case file; `act` is a step of a run that uses its numbers, and `keys` what those begin with that are moved."""

    text: str
    act: str = ""
    keys: str = ""


def part(name: str, **words: str) -> str:
    return Template(PARTS[name]).substitute(words)


def section(number: int, scale: float = 1.0) -> str:
    shape, sizes = list(SHAPES.items())[number]
    return f'{{ shape = "{shape}", {", ".join(f"{key} = {value * scale:.5g}" for key, value in sizes.items())} }}'


def read(*dofs: str) -> str:
    return part("read", channels=", ".join(f'c{i} = {{ dof = "{dof}" }}' for i, dof in enumerate(dofs)))


def beam(number: int = 0, more: str = 'element = "paper"') -> str:
    return part("beam", section=section(number), law=LAWS[number % 3], more=more)


def uncertain(form: str, *names: str) -> str:
    return "".join(f"[uncertain.{name}]\n{form}\n" for name in names)


def material(shift: int) -> str:
    return f"youngs_modulus_gpa = {201 + shift}.0\npoissons_ratio = 0.{21 + shift}\ndensity_kg_m3 = {7801 + shift}.0"


def body(number: int) -> str:
    """Two members, of which the first states everything that it may, and a mass."""
    own, shear = ", ".join(material(1).splitlines()), SHEAR[number % 2]
    return part("body", own=own, shear=shear, section=section(number, 1.1), end=section(number, 0.9))


def frame(number: int) -> str:
    shear, law = SHEAR[number % 2].replace("8", "7"), LAWS[number % 3]
    return part("frame", material=material(0), shear=shear, section=section(number), law=law)


def tool(number: int) -> str:
    shear = SHEAR[number % 2].replace("8", "6")
    return part("second body", material=material(2), shear=shear, section=section(number, 1.2), body=body(number))


def synthetic(lines: str = PARTS["band"], noise: str = "relative = 0.03, floor = 0.01", truth: str = "") -> str:
    return part("synthetic", lines=lines, noise=noise, truth=truth or PARTS["truth"])


PAIR, USUAL, FEET = PARTS["pair"], beam() + PARTS["pair"] + read("8:y"), PARTS["stiffness of feet"]
BARE = beam().replace("accelerometer_mass_g = 3.1\n", "") + PAIR
FILES = PARTS["files coherence"], PARTS["files relative"], PARTS["files windowed"]
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
FRAMES = [frame(i) + body(i) + PAIR.replace("1:", "a:") + read("c:y") for i in range(4)]
BODIES = [frame(i) + tool(i) + PAIR.replace("1:", "tool.a:") + read("tool.c:y") for i in range(4)]
OF_BODIES = [
    frame(0) + PARTS["two bodies"]
    + PAIR.replace("1:", "tool.a:").replace("initial", 'against = ["rest.p:y", "rest.p:rz"]\ninitial')
    + read("tool.b:y")
    + uncertain(form, *(f"bodies.tool.{name}" for name in QUANTITIES[:6] if name != "length"))
    + uncertain(length, "bodies.tool.length")
    for form, length in ((SD, SD), (ENDS, ENDS), (SD, "sd_mm = 0.2"))
]  # fmt: skip
CHAINS = [part("chain", law=law.strip()) + read("b:x") for law in (*LAWS, PARTS["dampers"])]
MATRICES = [
    part("matrices", law=law, stiffness=one.format(7), mass=other.format(9)) + PAIR + read("2:y")
    for law, one, other in (
        (LAWS[0], ROWS, DIAGONAL),
        (LAWS[1], DIAGONAL, ROWS),
        (LAWS[2], ROWS, ROWS),
        (f'law = "matrix", damping_matrix = {ROWS.format(3)}', ROWS, ROWS),
        (f'law = "matrix", damping_matrix = {DIAGONAL.format(5)}', ROWS, ROWS),
    )
]
TWO_POINTS, SPRINGS = PARTS["two points"] + read("2:y"), PARTS["priors of springs"]
JOINTS = [
    f"{TWO_POINTS}[joint]\n{PARTS['placed']}[prior]\n{SPRINGS}",
    beam() + PARTS["signed"] + read("8:y"),
    f"{TWO_POINTS}[joints.left]\n{PARTS['placed']}[joints.left.prior]\n{SPRINGS}{PARTS['signed on the right']}",
]
MEASURED = [
    f'{BARE}[data]\nkind = "{kind}"\nfile = ["data.uff"]\n{files}{PARTS[more]}'
    for files in FILES
    for kind, more in (("measured_frf", "rotations"), ("measured_frequencies", "peaks"))
]
SPINDLE = [
    BARE.replace("initial", 'against = ["s:y", "s:rz"]\ninitial') + read("8:y")
    + '[bodies.spindle]\nkind = "measured"\nfile = ["spindle.uff"]\n'
    + files.replace("8:y", "s:y").replace("7:", "r:").replace('"6"', "p") + PARTS["rotation of the spindle"]
    for files in FILES
]  # fmt: skip
SYNTHETIC = [
    beam(0) + PAIR + synthetic(truth=PARTS["truth otherwise"]),
    beam(3) + PAIR + synthetic("frequencies_hz = [21.0, 45.0]", "coherence = 0.93, averages = 11, floor = 0.02"),
    beam(1) + PARTS["tip"] + synthetic(truth="stiffness = { ky = 5e7, krz = 6e4 }"),
    beam(1) + PARTS["feet"] + synthetic(truth=f"stiffness = {FEET}"),
]
FREQUENCIES, MODES = BARE + PARTS["frequencies"], BARE + PARTS["modes"]
WHOLE = beam() + PAIR + synthetic()
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
    *(KeyCase(USUAL + PARTS[noise], keys="noise") for noise in ("student", "integrated")),
    *(KeyCase(text, keys="data") for text in (FREQUENCIES, MODES)),
    KeyCase(MODES + uncertain(SD, "youngs_modulus"), keys="data.modes.\\.eigen|uncertain"),
    KeyCase(BARE + PARTS["eigenvalues"] + uncertain(ENDS, "youngs_modulus"), keys="data.modes.\\.eigen|uncertain"),
    KeyCase(FREQUENCIES + PARTS["model error"], keys="uncertain"),
    KeyCase(f"{MODES}[left_out]\nmodes = [2]\n", keys="left_out"),
    KeyCase(f"{WHOLE}[left_out]\nbands_hz = [[110.0, 205.0], [410.0, 520.0]]\n", keys="left_out"),
    *(
        KeyCase(f"{made}[reference]\nsource = 'a table'\nstiffness = {stated}\n", keys="reference")
        for made, stated in ((SYNTHETIC[2], "{ ky = 5e7, krz = 6e4 }"), (SYNTHETIC[3], FEET))
    ),
    KeyCase(WHOLE + PARTS["settings"], "identify", "iden|samp|ref|verd"),
    KeyCase(USUAL + PARTS["several tests"], keys="tests"),
]
