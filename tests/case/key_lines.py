"""Which number of what is built each number of a case file names, and in which unit: the table of `test_keys`.

A line holds a key of the schema (``*`` for a name or a place in a list), the numbers that it names, in which ``{0}``
stands for the first of these names, and a factor on what is in the file, or a function of it.
"""

import math
import re
from collections.abc import Callable
from functools import cache

import numpy as np

MM, GRAM, GPA, PERCENT = 1e-3, 1e-3, 1e9, 1e-2
#: A factor, or what the number is as a function of that in the file.
Value = float | Callable[[float], float]
STRUCTURE = "(truth.)?structure.recipe."
MEMBER, OF_FRAME = "structure.recipe.bodies.{}.members[{}].", "structure.recipe.bodies.(-.members[1]|rest.members[0])."
#: Where a frame states material, section and shear coefficient, and the members that take them from there.
OWNERS = {
    "structure{frame}.": OF_FRAME,
    "structure{frame}.members[*].": MEMBER.format("-", "{0}"),
    "structure{frame}.bodies.*.": MEMBER.format("{0}", "1"),
    "structure{frame}.bodies.*.members[*].": MEMBER.format("{0}", "{1}"),
}
SIZES = {
    "circle": ("diameter_mm",),
    "tube": ("outer_diameter_mm", "inner_diameter_mm"),
    "rectangle": ("width_mm", "height_mm"),
    "box": ("width_mm", "height_mm", "wall_mm"),
}
MATERIAL = (
    ("youngs_modulus_gpa", "youngs_modulus", GPA),
    ("poissons_ratio", "poissons_ratio", 1),
    ("density_kg_m3", "density", 1),
)


#: Sizes of the model's error whose keys are named otherwise.
ERROR_KEYS = {"factor": "error_factor", "spring_factor": "spring_factor"}


def of_structures() -> list[tuple[str, str, Value]]:
    """Lines of the tables of structures."""
    lines: list[tuple[str, str, Value]] = [
        ("structure{beam}.length_mm", f"{STRUCTURE}length", MM),
        ("structure{beam}.elements", f"{STRUCTURE}elements", 1),
        ("structure{beam}.shear_coefficient", f"{STRUCTURE}shear_coefficient", 1),
        ("structure{beam}.axial_force_n", f"{STRUCTURE}axial_force", 1),
        ("structure{beam}.at_mm.*", f"{STRUCTURE}points.{{0}}", MM),
    ]
    for key, name, unit in MATERIAL:
        lines.append((f"structure{{beam}}.{key}", f"{STRUCTURE}material.{name}", unit))
        lines += [(f"{owner}{key}", f"{members}material.{name}", unit) for owner, members in OWNERS.items()]
    sections = {f"{owner}section": f"{members}section" for owner, members in OWNERS.items()}
    sections |= {key.replace("section", "end_section"): name.replace("section", "end_section")
                 for key, name in sections.items() if key.endswith("members[*].section")}  # fmt: skip
    for owner, name in {"structure{beam}.section": f"{STRUCTURE}section", **sections}.items():
        lines += [
            (f"{owner}{{{shape}}}.{key}", f"{name}[{i}]", MM)
            for shape, keys in SIZES.items()
            for i, key in enumerate(keys)
        ]
    for owner, members in OWNERS.items():
        last = f"{{{owner.count('*')}}}"
        lines.append((f"{owner}axial_force_n", f"{members}axial_force", 1))
        lines.append((f"{owner}shear_coefficient", f"{members}shear_coefficient", 1))
        lines.append((f"{owner}shear_coefficient[*]", f"{members}shear_coefficient[{last}]", 1))
    for body, name, n in (("", "-", 0), ("bodies.*.", "{0}", 1)):
        frame, built = f"structure{{frame}}.{body}", f"structure.recipe.bodies.{name}."
        a, b, c = (f"{{{n + i}}}" for i in range(3))
        lines += [
            (f"{frame}points.*[*]", f"{built}points.{a}[{b}]", MM),
            (f"{frame}members[*].offsets_mm[*][*]", f"{built}members[{a}].offsets[{b}][{c}]", MM),
            (f"{frame}members[*].up[*]", f"{built}members[{a}].up[{b}]", 1),
            (f"{frame}masses[*].mass_kg", f"{built}masses[{a}].mass", 1),
            (f"{frame}masses[*].inertia_kg_m2[*]", f"{built}masses[{a}].inertia[{b}]", 1),
            (f"{frame}masses[*].offset_mm[*]", f"{built}masses[{a}].offset[{b}]", MM),
        ]
    for kind in ("beam", "frame", "chain", "matrices"):
        lines += [
            (f"structure{{{kind}}}.accelerometer_mass_g", f"{STRUCTURE}accelerometer_mass", GRAM),
            (f"structure{{{kind}}}.damping{{modal}}.ratio[*]", f"{STRUCTURE}damping.ratios[{{0}}]", 1),
            (f"structure{{{kind}}}.damping{{loss_factor}}.loss_factor", f"{STRUCTURE}damping.loss_factor", 1),
            (f"structure{{{kind}}}.damping{{rayleigh}}.alpha_per_s", f"{STRUCTURE}damping.alpha", 1),
            (f"structure{{{kind}}}.damping{{rayleigh}}.beta_s", f"{STRUCTURE}damping.beta", 1),
        ]
    masses = [
        (f"structure{{chain}}.masses_kg.{name}", f"structure.recipe.mass[{i},{i}]", 1) for i, name in enumerate("abc")
    ]
    chain, springs = "structure.recipe.", "structure{chain}.springs[{}].stiffness_n_per_m"
    dampers = "structure{chain}.damping{dampers}.dampers[{}].damping_n_s_per_m"
    lines += [
        *masses,
        (springs.replace("{}", "0"), f"{chain}stiffness[(0,0|1,1)]", 1),
        (springs.replace("{}", "0"), f"{chain}stiffness[(0,1|1,0)]", -1),
        (springs.replace("{}", "1"), f"{chain}stiffness[2,2]", 1),
        (dampers.replace("{}", "0"), f"{chain}damping.viscous_matrix[0,0]", 1),
        (dampers.replace("{}", "1"), f"{chain}damping.viscous_matrix[(1,1|2,2)]", 1),
        (dampers.replace("{}", "1"), f"{chain}damping.viscous_matrix[(1,2|2,1)]", -1),
        ("structure{matrices}.points.*[*]", f"{chain}positions.{{0}}[{{1}}]", MM),
    ]
    for key, name in (("stiffness", "stiffness"), ("mass", "mass"),
                      ("damping{matrix}.damping_matrix", "damping.viscous_matrix")):  # fmt: skip
        lines.append((f"structure{{matrices}}.{key}[*]", f"{chain}{name}[{{0}},{{0}}]", 1))
        lines.append((f"structure{{matrices}}.{key}[*][*]", f"{chain}{name}[({{0}},{{1}}|{{1}},{{0}})]", 1))
    return lines


def of_joints() -> list[tuple[str, str, Value]]:
    """Lines of joints, their priors and what else is uncertain."""
    lines: list[tuple[str, str, Value]] = []
    spread = math.log(10) / 1.959963984540054
    for joint, built, priors, name in (
        ("joint", "", "prior", "{0}"),
        ("joints.*", ".{0}", "joints.*.prior", "{0}.{1}"),
    ):
        a, b = ("{0}", "{1}") if joint == "joint" else ("{1}", "{2}")
        lines += [
            (f"{joint}.axes[*][*]", f"joint{built}.axes[{a}][{b}]", 1),
            (f"{joint}.offset_mm[*]", f"joint{built}.offset_m[{a}]", MM),
            (f"{joint}.offset_against_mm[*]", f"joint{built}.offset_against_m[{a}]", MM),
            *((f"{joint}.initial.{k}", f"initial{built}.{k}", 1) for k in ("k11", "k12", "k22")),
            *((f"{priors}.*{{log_uniform}}.{end}", f"prior.{name}.{end}", math.log) for end in ("low", "high")),
            *((f"{priors}.*{{uniform}}.{end}", f"prior.{name}(.given)?.{end}", 1) for end in ("low", "high")),
            *((f"{priors}.*{{normal}}.{key}", f"prior.{name}.given.{key}", 1) for key in ("mean", "sd")),
            (f"{priors}.*{{log_normal}}.median", f"prior.{name}.mean", math.log),
            (f"{priors}.*{{log_normal}}.sd_log", f"prior.{name}.sd", 1),
            (f"{priors}.*{{decades}}.guess", f"prior.{name}.mean", math.log),
            (f"{priors}.*{{decades}}.decades", f"prior.{name}.sd", spread),
        ]
    quantities = ["youngs_modulus", "density", "length", "section_size", "shear_coefficient", "axial_force"]
    alone = ["loss_factor", "accelerometer_mass", "gain"]
    several = {"damping_ratio": "damping_ratio_(1|2)"}
    names = (
        {name: name for name in (*quantities, *alone)} | several | {f"bodies.*.{q}": f"{{0}}.{q}" for q in quantities}
    )
    for key, name in names.items():
        lines += [
            (f"uncertain.{key}.sd_percent", f"nuisance.{name}.prior.sd", PERCENT),
            (f"uncertain.{key}.low_factor", f"nuisance.{name}.prior.low", math.log),
            (f"uncertain.{key}.high_factor", f"nuisance.{name}.prior.high", math.log),
            # the modes of the structure are made for so much
            (f"uncertain.{key}.sd_percent", f"structure.ranges.{name}[0]", -6 * PERCENT),
            (f"uncertain.{key}.sd_percent", f"structure.ranges.{name}[1]", 6 * PERCENT),
            (f"uncertain.{key}.low_factor", f"structure.ranges.{name}[0]", math.log),
            (f"uncertain.{key}.high_factor", f"structure.ranges.{name}[1]", math.log),
        ]
    return [
        *lines,
        *((f"uncertain.{key}.sd_mm", target.format(name), sign / mm)
          for key, name, mm in (("length", "length", 759.0), ("length_offset", "length_offset", 1000.0),
                                ("bodies.tool.length", "tool.length", 500.0))  # from 0, 0, 0 to 300, 0, 400 mm
          for target, sign in (("nuisance.{}.prior.sd", 1), ("structure.ranges.{}[0]", -6),
                               ("structure.ranges.{}[1]", 6))),
        *((f"uncertain.length_offset.{end}_mm", target.format(end), MM)
          for end, i in (("low", 0), ("high", 1))
          for target in ("nuisance.length_offset.prior.{}", f"structure.ranges.length_offset[{i}]")),
        # stated values of what is uncertain, in the units of the file
        ("structure{beam}.youngs_modulus_gpa", "nuisance.youngs_modulus.nominal", 1),
        ("structure{beam}.density_kg_m3", "nuisance.density.nominal", 1),
        ("structure{beam}.length_mm", "nuisance.length.nominal", 1),
        ("structure{beam}.axial_force_n", "nuisance.axial_force.nominal", 1),
        ("structure{beam}.accelerometer_mass_g", "nuisance.accelerometer_mass.nominal", 1),
        ("structure{beam}.damping{loss_factor}.loss_factor", "nuisance.loss_factor.nominal", 1),
        ("structure{beam}.damping{modal}.ratio[0]", "nuisance.damping_ratio_1.nominal", 1),
        ("structure{beam}.damping{modal}.ratio[1]", "nuisance.damping_ratio_2.nominal", 1),
    ]  # fmt: skip


def of_files() -> list[tuple[str, str, Value]]:
    """Lines of data from files, and of bodies that are measured."""
    lines: list[tuple[str, str, Value]] = []
    for table, name in (
        ("data{measured_frf}", "data"),
        ("data{measured_frequencies}", "data"),
        ("bodies.*{measured}", "spindle"),
    ):
        channel, band = ("{1}", "[{1}][{2}]") if name == "spindle" else ("{0}", "[{0}][{1}]")
        files, records = f"files.{name}.", f"{table}.records."
        lines += [
            (f"{table}.channels.*.gain", f"{files}channels.{channel}.gain", 1),
            (f"{table}.channels.*.sensitivity", f"{files}channels.{channel}.unit.sensitivity", 1),
            (f"{table}.channels.*.accelerometer_mass_g", f"{files}channels.{channel}.accelerometer_mass", GRAM),
            *((f"{table}.f_{end}_hz", f"{files}(signals.)?f_{end}_hz", 1) for end in ("min", "max")),
            (f"{table}.thin", f"{files}line_step", 1),
            (f"{table}.exclude_hz[*][*]", f"{files}exclude_hz{band}", 1),
            (f"{table}.variance.averages", f"{files}variance.averages", 1),
            *((f"{table}.variance.{key}", f"{files}variance.law.{key}", 1) for key in ("relative", "floor")),
            *((f"{records}{key}", f"{files}signals.(hits.)?{key}", 1)
              for key in ("block_s", "pretrigger_s", "force_range_n", "force_window_s", "exponential_end", "overlap")),
        ]  # fmt: skip
    rotations = "data{measured_frf}.rotations."
    return [
        *lines,
        (f"{rotations}1:rz.spacing_mm", "files.data.rotations.1:rz.spacing", MM),
        (f"{rotations}8:rz.spacing_mm", "files.data.rotations.8:rz.spacing", -MM),
        ("structure{beam}.length_mm", "files.data.rotations.4:rz.spacing", 2 * MM / 7),
        ("structure{beam}.elements", "files.data.rotations.4:rz.spacing", lambda n: 2 * 0.759 / n),
        ("bodies.*{measured}.rotations.*.spacing_mm", "rotations.{1}.spacing", MM),
        *((f"data{{measured_frequencies}}.{key}", f"files.data.frequencies.{key}", 1)
          for key in ("modes", "sd_relative", "sd_hz")),
    ]  # fmt: skip


def drawn(seed: float) -> float:
    """What a generator of a seed gives first."""
    return float(np.random.default_rng(int(seed)).random())


def count_to(top: float, low: float = 20.0, step: float = 5.0) -> float:
    """Lines of a band."""
    return math.floor((top - low) / step + 1e-9) + 1


def of_data() -> list[tuple[str, str, Value]]:
    """Lines of data that a case states or makes, and of the noise model."""
    synthetic, truth, modes = "data{synthetic_frf}.", "data{synthetic_frf}.truth.", "data{modes}."
    lines = "(data|truth.ports)."
    natural = "data{natural_frequencies}."
    return [
        (f"{synthetic}f_min_hz", f"{lines}first", 1),
        (f"{synthetic}f_min_hz", f"{lines}count", lambda f: count_to(1000.0, low=f)),
        (f"{synthetic}f_max_hz", f"{lines}count", count_to),
        (f"{synthetic}f_step_hz", f"{lines}step", 1),
        (f"{synthetic}f_step_hz", f"{lines}count", lambda f: count_to(1000.0, step=f)),
        (f"{synthetic}frequencies_hz[0]", f"{lines}first", 1),
        (f"{synthetic}frequencies_hz[0]", f"{lines}step", lambda f: 45.0 - f),
        (f"{synthetic}frequencies_hz[1]", f"{lines}step", lambda f: f - 21.0),
        *((f"{synthetic}noise.{key}", f"truth.law.{key}", 1) for key in ("relative", "floor", "coherence", "averages")),
        (f"{synthetic}noise.seed", "truth.rng", drawn),
        (f"{truth}k11", "truth.matrix.stiffness[0,0]", 1),
        (f"{truth}k12", "truth.matrix.stiffness[(0,1|1,0)]", 1),
        (f"{truth}k22", "truth.matrix.stiffness[1,1]", 1),
        (f"{truth}stiffness.(left.)?ky", "truth.matrix.stiffness[0,0]", 1),
        (f"{truth}stiffness.(left.)?krz", "truth.matrix.stiffness[1,1]", 1),
        (f"{truth}stiffness.right.ky", "truth.matrix.stiffness[2,2]", 1),
        (f"{truth}stiffness.right.krz", "truth.matrix.stiffness[3,3]", 1),
        (f"{truth}youngs_modulus_gpa", "truth.structure.recipe.material.youngs_modulus", GPA),
        (f"{truth}density_kg_m3", "truth.structure.recipe.material.density", 1),
        (f"{truth}length_mm", "truth.structure.recipe.length", MM),
        (f"{truth}accelerometer_mass_g", "truth.structure.recipe.accelerometer_mass", GRAM),
        (f"{truth}gain", "truth.gain", 1),
        (f"{truth}damping_ratio[*]", "truth.structure.recipe.damping.ratios[{0}]", 1),
        (f"{natural}frequencies_hz[*]", "data.frequency_hz[{0}]", 1),
        (f"{natural}frequencies_hz[*]", "data.sd_hz[{0}]", lambda f: math.hypot(0.01 * f, 0.5)),
        *((f"{natural}sd_relative", f"data.sd_hz[{i}]", lambda r, f=f: math.hypot(r * f, 0.5))
          for i, f in enumerate((31.0, 210.0))),
        *((f"{natural}sd_hz", f"data.sd_hz[{i}]", lambda s, f=f: math.hypot(0.01 * f, s))
          for i, f in enumerate((31.0, 210.0))),
        (f"{modes}numbers[*]", "data.numbers[{0}]", 1),
        (f"{modes}zeros.numbers[*]", "data.zeros.numbers[{0}]", 1),
        (f"{modes}shapes.components[*][*][*]", "data.shapes.components.values[{0},{1},{2}]", 1),
        (f"{modes}shapes.sd[*]", "data.shapes.components.sd[*,{0},*]", 1),
        ("noise.dof", "noise.dof", 1),
        ("noise.scale_dof", "noise.dof", 1),
        ("noise.scale_guess", "noise.scale", 1),
        *((f"noise.scale_{end}_factor", f"nuisance.noise_scale.prior.{end}", math.log) for end in ("low", "high")),
        ("left_out.modes[*]", "left_out.modes[{0}]", 1),
        ("left_out.bands_hz[*][*]", "left_out.bands_hz[{0}][{1}]", 1),
        *((f"uncertain.model_error.{ERROR_KEYS.get(name, f'{name}_error')}", f"{place}.{name}", 1)
          for name in (*ERROR_KEYS, "frequency", "damping", "shape", "constant", "edge", "spring")
          for place in ("noise.sizes", "model_error")),
    ]  # fmt: skip


#: Values of two repetitions, and their relative and absolute standard deviations.
REPEATED = {
    "frequencies_hz": ("frequency", ((31.0, 210.0), (33.0, 212.0)), (0.011, 0.012), (0.3, 0.7)),
    "damping_ratios": ("damping", ((0.011, 0.013), (0.012, 0.015)), (0.1, 0.2), (1e-3, 2e-3)),
    "eigenvalues": ("frequency", ((5700.0, 2.1e5), (5800.0, 2.2e5)), (0.011, 0.012), (60.0, 2000.0)),
    "zeros.frequencies_hz": ("zeros.frequency", ((32.0, 220.0), (34.0, 222.0)), (0.013, 0.014), (0.4, 0.8)),
    "constants.values_per_kg": ("constants.constants", ((0.5, 1.5), (0.6, 1.7)), (0.05, 0.06), (0.01, 0.02)),
}


def of_repeated() -> list[tuple[str, str, Value]]:
    """Lines of repeated values, whose relative standard deviation is one of their mean."""
    lines: list[tuple[str, str, Value]] = []
    for key, (name, values, relative, absolute) in REPEATED.items():
        one_dof, at = ("[0]", ",0") if key.startswith("constants") else ("", "")
        lines.append((f"data{{modes}}.{key}[*][*]{one_dof}", f"data.{name}.values[{{0}},{{1}}{at}]", 1))
        relative_key, absolute_key = {
            "damping_ratios": ("damping_sd_relative", "damping_sd"),
            "frequencies_hz": ("sd_relative", "sd_hz"),
            "eigenvalues": ("sd_relative", "eigenvalue_sd"),
            "zeros.frequencies_hz": ("zeros.sd_relative", "zeros.sd_hz"),
            "constants.values_per_kg": ("constants.sd_relative", "constants.sd_per_kg"),
        }[key]
        for mode, (one, other) in enumerate(zip(*values, strict=True)):
            sd, r, s = f"data.{name}.sd[*,{mode}{at}]", relative[mode], absolute[mode]
            for row, rest in enumerate((other, one)):
                mean_of = f"data{{modes}}.{key}[{row}][{mode}]{one_dof}"
                lines.append((mean_of, sd, lambda v, rest=rest, r=r, s=s: math.hypot(r * (v + rest) / 2, s)))
            mean = (one + other) / 2
            if key != "eigenvalues":
                lines.append((f"data{{modes}}.{relative_key}[{mode}]", sd, lambda v, m=mean, s=s: math.hypot(v * m, s)))
            lines.append((f"data{{modes}}.{absolute_key}[{mode}]", sd, lambda v, m=mean, r=r: math.hypot(r * m, v)))
    return lines


def of_settings() -> list[tuple[str, str, Value]]:
    """Lines of what is done with the data."""
    impact, hammer = "frfs_of_hits[1].", "hammer_records"
    return [
        *((f"identification.{key}", f"iteration.{key}", 1) for key in ("max_steps", "threshold", "line_weight")),
        *((f"sampling.{key}", f"sampler.{key}", 1) for key in ("ensembles", "walkers", "max_steps", "budget_s")),
        ("sampling.seed", "seed", 1),
        *((f"reference.{key}", f"reference[{i}]", 1) for i, key in enumerate(("k11", "k12", "k22"))),
        *(
            (f"reference.stiffness.{key}", f"reference[{i}]", 1)
            for i, key in enumerate(("(left.)?ky", "(left.)?krz", "right.ky", "right.krz"))
        ),
        ("reference.natural_frequencies_hz[*]", "published[{0}]", 1),
        ("plan.max_measurements", "plan.size", 1),
        ("plan.averages_factor", "plan.averages.law", lambda n: 1 / (n - 1)),  # of noise of variance 1
        ("plan.f_max_hz", "plan.band.ports.count", count_to),
        ("plan.added_mass_g", "plan.mass.structure.recipe.added_mass", GRAM),
        ("virtual_test.averages", "noisy_frf[2]", 1),
        ("virtual_test.averages", f"{hammer}[1].hits", 1),
        ("virtual_test.seed", "(noisy_frf|hammer_records|shaker_records)[3]", drawn),
        ("virtual_test.block_s", "(hammer|shaker)_records[0].block", 3000),
        ("virtual_test.block_s", "frfs_of_shaker[1].block_s", 1),
        ("virtual_test.sample_rate_hz", "(hammer|shaker)_records[0].sample_rate_hz", 1),
        ("virtual_test.sample_rate_hz", "(hammer|shaker)_records[0].block", 0.5),
        *((f"virtual_test.{key}_noise", f"(hammer|shaker)_records[2].{key}", 1) for key in ("force", "response")),
        *((f"virtual_test.{key}", f"{hammer}[1].{key}", 1) for key in ("double_hits", "overloads")),
        ("virtual_test.exponential_end", f"{impact}exponential_end", 1),
        ("virtual_test.overlap", "frfs_of_shaker[1].overlap", 1),
        ("tests.*.level", "tests.{0}.level.value", 1),
        *(("assembly.scatter", f"scatters[{i}].median", 1) for i in range(3)),
        *(("assembly.scatter_factor", f"scatters[{i}].factor", 1) for i in range(3)),
        ("tests.low.structure.length_mm", "tests.low.structure.recipe.length", MM),
        ("tests.high.uncertain.density.sd_percent", "nuisance.high.density.prior.sd", PERCENT),
        ("tests.high.uncertain.density.sd_percent", "tests.high.structure.ranges.density[0]", -6 * PERCENT),
        ("tests.high.uncertain.density.sd_percent", "tests.high.structure.ranges.density[1]", 6 * PERCENT),
    ]


KEYS = [*of_structures(), *of_joints(), *of_files(), *of_data(), *of_repeated(), *of_settings()]


@cache
def expression(pattern: str) -> re.Pattern[str]:
    """A key of the schema, or of a line: ``*`` is one name or place, ``(a|b)`` one of these, ``(a)?`` a or nothing."""
    escaped = re.sub(r"\\([()|?])", r"\1", re.escape(pattern)).replace("(", "(?:")
    return re.compile(escaped.replace(r"\*", r"([^.,\[\]{}]+)"))
