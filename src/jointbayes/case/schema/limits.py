"""Limits of the numbers in a case file: beyond them lies no machine, only a slip of the hand or of the unit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from jointbayes.joint import COUPLED

#: Of the sampler: beyond these a run fills the memory of any computer, or never ends.
MOST_ENSEMBLES, MOST_WALKERS, MOST_STEPS, MOST_PROCESSES = 64, 10_000, 10_000_000, 256
#: Entries of lists: DOFs of 501 points with 5 each; ratios, each of which may be uncertain; files.
MOST_LABELS, MOST_RATIOS, MOST_FILES = 2505, 100, 1000
#: Values of the FRFs of synthetic data: more fill the memory.
MOST_VALUES = 10_000_000


@dataclass(frozen=True, slots=True)
class Limits:
    """The smallest and the largest magnitude of some keys, in their unit; zero is for the keys themselves to allow."""

    keys: tuple[str, ...]
    least: float
    most: float

    def hold(self, value: float) -> bool:
        """Whether a value is zero or within the limits, whatever its sign; so is NaN, where a key allows it."""
        return value == 0 or self.least <= abs(value) <= self.most or math.isnan(value)


def _of(keys: str, least: float, most: float) -> Limits:
    return Limits(tuple(keys.split()), least, most)


#: One row for each kind of number; docs/case-file.md shows the same table.
TABLE = (
    _of("length_mm spacing_mm offset_mm offset_against_mm", 1e-3, 1e6),
    _of("diameter_mm outer_diameter_mm inner_diameter_mm width_mm height_mm wall_mm", 1e-3, 1e5),
    _of("youngs_modulus_gpa", 1e-6, 1e15),
    _of("density_kg_m3", 1e-9, 1e9),
    _of("accelerometer_mass_g added_mass_g", 1e-12, 1e9),
    _of("mass_kg masses_kg", 1e-12, 1e9),
    _of("inertia_kg_m2", 1e-30, 1e9),
    _of("points offsets_mm offset_mm", 1e-30, 1e9),
    _of("up", 1e-30, 1e30),
    _of("stiffness_n_per_m damping_n_s_per_m", 1e-12, 1e15),
    _of("stiffness mass damping_matrix", 1e-100, 1e100),
    _of("loss_factor", 1e-12, 100.0),
    _of("alpha_per_s", 1e-12, 1e9),
    _of("beta_s", 1e-20, 1e3),
    _of(
        " ".join([*(quantity.name for quantity in COUPLED), "stiffness", "low high median guess mean sd"]),
        1e-12,
        1e15,
    ),
    _of("sd_log decades", 1e-6, 100.0),
    _of("sd_percent", 1e-6, 100.0),
    _of("sd_mm low_mm high_mm", 1e-6, 1e6),
    _of("level", 1e-30, 1e30),
    _of("low_factor high_factor scale_low_factor scale_high_factor", 1e-6, 1e6),
    _of("scale_low scale_high scale_guess averages_factor", 1e-6, 1e6),
    _of("dof scale_dof", 1e-6, 1e9),
    _of("f_min_hz f_max_hz f_step_hz frequencies_hz natural_frequencies_hz exclude_hz", 1e-6, 1e9),
    _of("sd_hz length_low_hz length_high_hz sample_rate_hz", 1e-6, 1e9),
    _of("relative floor", 1e-15, 1e3),
    _of("sd_relative damping_sd_relative damping_ratios damping_sd force_noise response_noise", 1e-15, 10.0),
    _of("eigenvalues eigenvalue_sd", 1e-12, 1e20),
    _of("components", 1e-15, 1e15),
    _of("gain", 1e-12, 1e12),
    _of("coherence", 1e-6, 1.0),
    _of("threshold", 1e-30, 1e3),
    _of("line_weight", 1e-6, 10.0),
    _of("block_s pretrigger_s force_window_s", 1e-9, 1e6),
    _of("force_range_n", 1e-12, 1e12),
)

#: Limits by key.
LIMITS: Mapping[str, Limits] = {key: limits for limits in TABLE for key in limits.keys}


def limit_text(value: float) -> str:
    """A limit as it stands in messages and in the documentation: 0.001, 100, 1e6."""
    mantissa, e, exponent = f"{value:g}".partition("e")
    return f"{mantissa}e{int(exponent)}" if e else (mantissa if value < 1e4 else f"1e{len(mantissa) - 1}")


def beyond(values: Mapping[str, object]) -> Iterator[tuple[tuple[str | int, ...], float, Limits]]:
    """Yield place, value and limits of the numbers of a table, and of its lists, that lie beyond their limits."""
    for key, value in values.items():
        limits = LIMITS.get(key)
        if limits is None or value is None:
            continue
        for place, number in _numbers((key,), value):
            if not limits.hold(number):
                yield place, number, limits


def _numbers(place: tuple[str | int, ...], value: object) -> Iterator[tuple[tuple[str | int, ...], float]]:
    """Yield place and value of each number in lists and tables of numbers."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield place, value
    parts = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, tuple) else ()
    for key, part in parts:
        yield from _numbers((*place, key), part)
