"""What the lights of page one find."""

from types import SimpleNamespace

import pytest

from jointbayes.report.sections import lead
from jointbayes.report.sections.lead import FINDINGS, _calculation


@pytest.mark.parametrize(("default", "finding"), [(True, "settled"), (False, "edge of a stated prior")])
def test_a_best_fit_at_the_edge_is_a_finding_only_where_the_case_states_the_prior(default, finding, monkeypatch):
    monkeypatch.setattr(lead, "mode_agrees", lambda _: True)
    posterior = SimpleNamespace(
        converged=True, best=SimpleNamespace(theta=None), record=SimpleNamespace(state="Converged."),
        case=SimpleNamespace(default_priors=("k11",) * default),
        problem=SimpleNamespace(
            premises=SimpleNamespace(of_modes=False),
            prior=SimpleNamespace(coordinates_at_edge=lambda _: ("k11",)),
        ),
    )  # fmt: skip
    found, text = _calculation(SimpleNamespace(posterior=posterior, summary=SimpleNamespace(mesh=None)))
    assert (found, "widen" in text) == (finding, not default)
    assert FINDINGS[found] == ("Calculation", "good" if default else "caution")
