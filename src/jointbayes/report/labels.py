"""Names of uncertain quantities, as sentences and as axes have them."""

from jointbayes.inference import Problem

_READABLE = {
    "youngs_modulus": "Young's modulus",
    "density": "density",
    "length": "length",
    "length_offset": "offset of the length",
    "section_size": "size of the section",
    "shear_coefficient": "shear coefficient",
    "damping_ratio": "damping ratio",
    "loss_factor": "loss factor",
    "accelerometer_mass": "accelerometer mass",
    "gain": "gain",
    "noise_scale": "noise, factor on the stated",
    "discrepancy_scale": "model discrepancy, in noise sd",
    "discrepancy_length": "its correlation length",
}
_SHORT = {
    "youngs_modulus": "ln E",
    "density": "ln density",
    "length": "ln L",
    "length_offset": "L offset",
    "section_size": "ln size",
    "shear_coefficient": "ln κ",
    "damping_ratio": "ln ζ",
    "loss_factor": "ln η",
    "accelerometer_mass": "ln mass",
    "noise_scale": "ln noise",
    "discrepancy_scale": "ln discr.",
    "discrepancy_length": "ln Hz",
}


def coordinate_labels(problem: Problem) -> list[str]:
    """Short label of each coordinate for an axis: of the joint, then of what else is uncertain."""
    axes = problem.parametrisation.axes
    return [axis.label for axis in axes] + [nuisance_label(name) for name in problem.names[len(axes) :]]


def nuisance_label(name: str) -> str:
    """Short label of an uncertain quantity for an axis; of one body or set-up with its name."""
    owner, _, quantity = name.rpartition(".")
    if owner:
        return f"{nuisance_label(quantity)} {owner}"
    if name.startswith("mode_frequency_"):
        return f"ln f{name.rsplit('_', 1)[1]}"
    if name.startswith("damping_ratio_"):
        return f"ln ζ{name.rsplit('_', 1)[1]}"
    return _SHORT.get(name, f"ln {name}")


def readable(name: str) -> str:
    """Name of an uncertain quantity in a sentence; of one body or set-up with its name."""
    owner, _, quantity = name.rpartition(".")
    if owner:
        return f"{readable(quantity)} of {owner}"
    if name.startswith("mode_frequency_"):
        return f"natural frequency {name.rsplit('_', 1)[1]}"
    if name.startswith("damping_ratio_"):
        return f"damping ratio of mode {name.rsplit('_', 1)[1]}"
    return _READABLE.get(name, name)
