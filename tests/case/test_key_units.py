"""Units at the end of keys."""

import pytest

from jointbayes.case.spec.fields import UNITS, same_stem, stem_of, unit_of


@pytest.mark.parametrize(("key", "unit"), [
    ("length_mm", "mm"), ("youngs_modulus_GPa", "gpa"), ("stiffness_n_per_mm", "n_per_mm"),
    ("damping_n_s_per_m", "n_s_per_m"), ("density_kg_m3", "kg_m3"), ("inertia_kg_mm2", "kg_mm2"), ("ratio", "ratio"),
    ("in", ""), ("f_max", ""),
])  # fmt: skip
def test_the_longest_unit_at_the_end_of_a_key_counts(key: str, unit: str) -> None:
    assert (unit_of(key), stem_of(key)) == (unit, ("" if unit == key else key[: -len(unit) - 1] if unit else key))


def test_a_key_in_another_unit_is_told_from_its_like() -> None:
    assert same_stem("sd_m", ["own", "sd_percent", "sd_mm"]) == "sd_mm"
    assert same_stem("sd", ["own", "sd_percent", "sd_mm"]) == "sd_percent"
    assert same_stem("stiffness_kn_per_mm", ["dof", "stiffness_n_per_m"]) == "stiffness_n_per_m"
    assert same_stem("dofs", ["dof", "stiffness_n_per_m"]) is None


def test_units_of_a_kind_have_the_sizes_that_they_stand_for() -> None:
    assert UNITS["kn_per_mm"][1] == pytest.approx(UNITS["kn"][1] / UNITS["mm"][1])
    assert UNITS["kg_mm2"][1] == pytest.approx(UNITS["mm"][1] ** 2)
    assert UNITS["g_cm3"][1] == pytest.approx(UNITS["g"][1] / UNITS["cm"][1] ** 3)
    assert UNITS["ksi"][1] == pytest.approx(1000 * UNITS["psi"][1])
