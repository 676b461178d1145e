"""The paragraph on methods says what ran, each switch of a case changes it, and exactly what it cites is printed."""

import datetime
import re
from dataclasses import replace
from types import SimpleNamespace

import pytest
from benchmarks.size import ROOT

from jointbayes.inference import NoiseModel, Normal, StudentNoise
from jointbayes.posterior.checks import checks_of
from jointbayes.posterior.sampled import recall
from jointbayes.report import Report, render_html
from jointbayes.report.methods import methods_section, methods_text, packaged, references, report_text
from jointbayes.report.run_directory import write_into
from jointbayes.report.sections.run_details import sampling_section
from jointbayes.structure import Body, DampingLaw

SRC = ROOT / "src" / "jointbayes"
BIB = (SRC / "report" / "texts" / "references.bib").read_text(encoding="utf-8")
KEYS = re.findall(r"^@\w+\{(\w+),", BIB, re.MULTILINE)


@pytest.fixture(scope="module")
def inputs(cheap_posterior):
    """What the paragraph is made of, without what takes long to find."""
    summary = cheap_posterior.summary()
    tests = (SimpleNamespace(problem=cheap_posterior.problem, summary=summary.tests[""]),)
    knowledge = SimpleNamespace(profiles=(), weighed=())
    return SimpleNamespace(posterior=cheap_posterior, summary=summary, knowledge=knowledge, tests=tests)


def changed(inputs, **parts):
    return SimpleNamespace(**(vars(inputs) | parts))


def with_posterior(inputs, **parts):
    posterior = replace(inputs.posterior, **parts)
    recall(posterior, {"checks_of": checks_of(inputs.posterior)})
    return changed(inputs, posterior=posterior)


def with_test(inputs, **parts):
    test = SimpleNamespace(problem=inputs.posterior.problem.with_test(**parts), summary=inputs.tests[0].summary)
    return changed(inputs, tests=(test,))


def with_record(inputs, **parts):
    return with_posterior(inputs, record=replace(inputs.posterior.record, **parts))


def with_sampler(inputs, **figures):
    return with_record(inputs, sampler=inputs.posterior.record.sampler | figures)


def with_normal_prior(inputs):
    problem = inputs.posterior.problem
    prior = replace(problem.prior, marginals=(Normal(20.0, 1.0), *problem.prior.marginals[1:]))
    return with_posterior(inputs, problem=replace(problem, prior=prior))


def with_modulus(inputs):
    modulus = SimpleNamespace(prior_interval95=(201.8, 218.2), unit="GPa")
    return changed(inputs, summary=replace(inputs.summary, nuisances={"youngs_modulus": modulus}))


def with_check(inputs, **parts):
    other = with_posterior(inputs)
    recall(other.posterior, {"checks_of": (replace(inputs.posterior.check, **parts),)})
    return other


def of_k22(inputs, **known):
    k22 = inputs.summary.parameters["k22"]
    parameters = {"k22": replace(k22, known=replace(k22.known, **known))}
    return changed(inputs, summary=replace(inputs.summary, parameters=parameters))


SWITCHES = {
    "noise": (lambda i: with_test(i, noise=StudentNoise(2, 4.0)), "noise follows Student's t"),
    "mesh": (lambda i: changed(i, summary=replace(i.summary, mesh=None)), "taken as given"),
    "prior": (with_normal_prior, "The prior is normal in ln k11, uniform in ln k12"),
    "uncertain": (with_modulus, "Uncertain besides the joint were Young's modulus (201.8 to 218.2 GPa)"),
    "starts": (
        lambda i: with_posterior(i, estimate=replace(i.posterior.estimate, starts=i.posterior.estimate.starts[:3])),
        "from 3 starting points",
    ),
    "walkers": (lambda i: with_sampler(i, walkers=99), "ensembles of 99 walkers"),
    "thin": (lambda i: with_sampler(i, thin=7), "thinned by a factor of 7"),
    "reason": (lambda i: with_record(i, reason="not converged after 10 steps"), "The sampler: not converged after 10"),
    "check": (lambda i: with_check(i, chi2_per_line=9.0), "the data: the misfit is 3.00 times"),
    "seed": (lambda i: with_record(i, seed=17), "seed 17;"),
    "versions": (lambda i: with_record(i, versions=i.posterior.record.versions | {"numpy": "9.9"}), "NumPy 9.9,"),
}


@pytest.mark.parametrize("switch", SWITCHES)
def test_each_switch_changes_the_paragraph(inputs, switch):
    change, words = SWITCHES[switch]
    before, after = methods_text(inputs), methods_text(change(inputs))
    assert words in after
    assert words not in before


def test_draws_without_walkers_are_called_independent_and_have_no_figures_of_chains(inputs):
    without = with_sampler(inputs, move_acceptance={})
    text, section = methods_text(without), sampling_section(without)
    drawn = f"{len(inputs.posterior.theta)} independent draws"
    assert f"[cappe2008, owen2000]: {drawn}" in text
    assert drawn in section.blocks[0].text
    for word in ("ensembles of", "walkers", "with these moves"):
        assert word in methods_text(inputs)
        assert word not in text + section.blocks[0].text
    assert len(section.blocks) == 1 < len(sampling_section(inputs).blocks)


@pytest.mark.parametrize(
    ("change", "key", "cited"),
    [
        (lambda i: with_posterior(i, estimate=replace(i.posterior.estimate, iteration=None)), "cao", False),
        (lambda i: with_sampler(i, move_acceptance={"independence": 0.9}), "goodman2010", False),
        (lambda i: with_sampler(i, move_acceptance={"independence": 0.9}), "terbraak2006", False),
        (lambda i: with_check(i, whiteness=None), "ljung1978", False),
        (lambda i: changed(i, knowledge=SimpleNamespace(profiles=(1,), weighed=())), "raue2009", True),
        (lambda i: changed(i, knowledge=SimpleNamespace(profiles=(), weighed=(1,))), "meng1996", True),
        (lambda i: of_k22(i, limit=1.0), "neale1997", True),
    ],
)
def test_only_what_ran_is_cited(inputs, change, key, cited):
    before, after = (references(methods_text(each)) for each in (of_k22(inputs), change(of_k22(inputs))))
    assert (f"{{{key}," in before) != cited
    assert (f"{{{key}," in after) == cited


def test_every_kind_of_structure_damping_and_noise_has_words():
    def kinds(parent):
        children = [child for child in parent.__subclasses__() if child.__module__.startswith("jointbayes.")]
        return {name for child in children for name in ({child.__name__} | kinds(child))}

    for parent in (Body, DampingLaw, NoiseModel):
        assert kinds(parent) - {"UncertainBody", "GaussianSpread"} <= set(packaged("methods.toml")["words"])


def test_a_noise_model_of_ones_own_goes_by_its_name(inputs):
    class CableNoise(StudentNoise):
        pass

    assert " values; CableNoise." in methods_text(with_test(inputs, noise=CableNoise(2, 4.0)))


def test_every_citation_of_a_text_has_an_entry_and_every_doi_stands_in_the_code():
    texts = packaged("methods.toml")
    said = " ".join([*texts["run"].values(), *texts["text"].values()])
    cited = set(re.findall(r"\w+", " ".join(re.findall(r"\[([\w, ]+)\]", said))))
    assert cited == set(KEYS)
    assert len(KEYS) == len(set(KEYS))
    code = " ".join(file.read_text(encoding="utf-8") for file in SRC.rglob("*.py"))
    missing = [doi for doi in re.findall(r"doi += \{(.*?)\}", BIB) if doi not in code]
    assert missing == []


def test_the_section_has_the_paragraph_and_a_file_has_what_it_cites(inputs, tmp_path):
    section = methods_section(inputs)
    (paragraph,) = section.blocks
    assert section.appendix
    assert paragraph.text == methods_text(inputs)
    report = Report("Clamp", "", (), (section,), datetime.date(2026, 1, 5), "0")
    write_into(tmp_path, report, {})
    text = (tmp_path / "references.bib").read_text(encoding="utf-8")
    assert re.findall(r"^@\w+\{(\w+),", text, re.MULTILINE)[:2] == ["cao", "jointbayes"]
    assert "VERSION" not in text
    assert text.count("{") == text.count("}")
    assert "@" not in render_html(report).split("<main")[1].split("</main")[0]


def test_a_study_cites_what_its_text_names():
    text = report_text("nested")
    assert "Nested sampling was asked for" in text
    assert references(text).startswith("@article{speagle2020,")
