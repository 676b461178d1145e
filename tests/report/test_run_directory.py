"""A report builds nothing again that the run has built."""

import sys
from collections import Counter

import pytest

import jointbayes as jb
from tests.conftest import FEW_STEPS, cheap_text

#: What is built once in a run and must not be built again for its report: module, function.
BUILT = {
    "case": ("jointbayes.case.case", "_build"),
    "synthetic data": ("jointbayes.frf.synthetic", "synthesise_frf"),
    "paper's iteration": ("jointbayes.identification.paper_iteration", "sensitivity_iteration"),
}


@pytest.fixture
def counted(monkeypatch):
    """How often each was called, by whichever module."""
    calls = Counter()

    def counting(name, function):
        def count(*arguments, **options):
            calls[name] += 1
            return function(*arguments, **options)

        return count

    for name, (home, attribute) in BUILT.items():
        original = getattr(sys.modules[home], attribute)
        for module in [m for key, m in sys.modules.items() if key.startswith("jointbayes")]:
            if vars(module).get(attribute) is original:
                monkeypatch.setattr(module, attribute, counting(name, original))
    return calls


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_a_posterior_just_sampled_is_reported_from_what_it_carries(counted, tmp_path):
    case = jb.case_from_text("cheap", cheap_text())
    posterior = jb.sample(case, seed=1, settings=FEW_STEPS)
    assert counted == dict.fromkeys(BUILT, 1)
    jb.write_report(posterior, tmp_path / "run")
    assert counted == dict.fromkeys(BUILT, 1)
    posterior.save(tmp_path / "kept.nc")
    again = jb.load_posterior(tmp_path / "kept.nc")
    assert counted == dict.fromkeys(BUILT, 1) | {"paper's iteration": 2}
    jb.write_report(again, tmp_path / "again")
    assert counted == dict.fromkeys(BUILT, 1) | {"paper's iteration": 2}
    same = ("summary.json", "case.toml", "report.html")
    assert [(tmp_path / "run" / name).read_bytes() for name in same] == [
        (tmp_path / "again" / name).read_bytes() for name in same
    ]
