"""One posterior, one verdict, one interval: every surface gives the same numbers of a run."""

import json
import re

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.cli.common import print_summary
from jointbayes.report import ReportInputs, build_report
from jointbayes.report.export import central_joint
from jointbayes.report.sections.lead import answer_text
from tests.posterior.test_decision import of_another_truth
from tests.report.conftest import DATE


@pytest.fixture(scope="module")
def by_modes(cheap_case):
    """Of measured FRFs of a beam half a millimetre longer than the one that is analysed."""
    return jb.sample(of_another_truth(cheap_case, "length_mm = 383.5"), seed=1)


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
@pytest.mark.parametrize("kind", ["by_modes", "cheap_posterior", "frequency_posterior"])
def test_every_surface_gives_the_same_numbers(kind, request, tmp_path, capsys):
    posterior = request.getfixturevalue(kind)
    inputs = ReportInputs(posterior)
    summary, page_one = inputs.summary, str(build_report(inputs, DATE).lead)
    told = json.loads(json.dumps(summary.to_json()))["parameters"]
    frame = summary.to_dataframe()
    print_summary(posterior, inputs.knowledge)
    printed = capsys.readouterr().out
    posterior.save(tmp_path / "posterior.nc")
    again = jb.load_posterior(tmp_path / "posterior.nc", posterior.problem)
    drawn = posterior.to_arviz()["posterior"]
    medians = dict(zip(posterior.stiffness_names, np.median(posterior.stiffness, axis=0), strict=True))
    theta, _ = central_joint(posterior)
    exported = dict(zip(medians, posterior.problem.prior.values(theta), strict=True))
    for name in posterior.stiffness_names:
        known, unit = posterior.verdict(name), posterior.unit(name)
        assert repr(summary.parameters[name].known) == repr(known)
        assert repr(again.verdict(name)) == repr(known)
        np.testing.assert_allclose([posterior.interval(name), again.interval(name)], [known.interval95] * 2, rtol=1e-12)
        np.testing.assert_allclose(frame.loc[name, ["low95", "high95"]].tolist(), known.interval95, rtol=1e-12)
        np.testing.assert_allclose(told[name]["interval95"], known.interval95, rtol=1e-12)
        assert (told[name]["verdict"], frame.loc[name, "verdict"]) == (known.verdict, known.verdict)
        assert told[name]["median"] == pytest.approx(medians[name]) == pytest.approx(known.median)
        assert exported[name] == pytest.approx(known.median, rel=1e-6)
        # thinned to whole chains: by a few Monte Carlo errors
        assert abs(float(np.median(drawn[name].values)) - known.median) < 8 * known.median_error
        assert answer_text(known, unit) in page_one
        (line,) = re.findall(rf"^{re.escape(name)}: .*", printed, re.MULTILINE)
        assert known.limit_in_words in line if known.limit else known.interval(" to ") in line
        assert known.verdict in line


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_measured_frfs_say_everywhere_what_they_are_analysed_as(by_modes, capsys):
    inputs = ReportInputs(by_modes)
    premises = by_modes.problem.premises
    assert premises.of_modes
    (first, reason, *_) = by_modes.premises_sentences
    print_summary(by_modes, inputs.knowledge)
    page = " ".join(map(str, build_report(inputs, DATE).blocks()))
    for said in (capsys.readouterr().out, repr(by_modes), by_modes._repr_html_(), str(by_modes.summary()), page):
        assert first in said
        assert reason in said
    assert inputs.summary.to_json()["premises"]["reason"] == premises.reason
    assert "analysed by the 3 modes that they show" in page
