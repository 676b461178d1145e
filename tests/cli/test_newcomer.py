"""What a newcomer runs into in the first hour: each slip is told where it is, with what to do, in a whole line."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.cli.files import _structure_in_words
from tests.conftest import cheap_text, cli

# ---- validate


def test_validate_and_report_state_the_same_prior(tmp_path, cheap_posterior):
    path = tmp_path / "clamp.toml"
    path.write_text(cheap_text(), encoding="utf-8")
    (entry,) = json.loads(cli("validate", path, "--json").stdout)["cases"]
    told = [line.partition(" from ")[2].split(" to ") for line in entry["understood"] if line.startswith("unknown ")]
    low, high = np.array([[float(a), float(b.split()[0])] for a, b in told]).T
    for at, (name, stated) in enumerate(cheap_posterior.summary().parameters.items()):
        assert np.log(low[at] / stated.prior_interval95[0]) == pytest.approx(0, abs=0.3), name
        assert np.log(high[at] / stated.prior_interval95[1]) == pytest.approx(0, abs=0.3), name
    assert high[1] ** 2 < high[0] * high[2]  # k12² <= k11 k22 in every joint


@pytest.mark.parametrize(
    ("kind", "what", "names", "words"),
    [
        ("beam", "300 mm", (), "beam 300 mm, 40 × 8 mm, modal damping"),
        (
            "beam",
            "300 mm",
            ("youngs_modulus", "damping_ratio_1", "damping_ratio_2", "damping_ratio_4"),
            "beam 300 mm, 40 × 8 mm, modal damping; uncertain: Young's modulus and damping of modes 1 to 4",
        ),
        ("imported", "solid_bar.npz, 9 DOFs", (), "solid_bar.npz, 9 DOFs, modal damping"),
    ],
)
def test_validate_says_the_structure_in_words(kind, what, names, words):
    recipe = SimpleNamespace(kind=kind, what=what, damping=jb.ModalDamping((0.01,)))
    test = SimpleNamespace(structures=SimpleNamespace(recipe=recipe, names=names), measured_bodies=())
    assert _structure_in_words(test, {"40 × 8 mm": []}) == words


# ---- wrong calls
