"""Measured bodies of a case file: read through channels, rotations and offsets, and what is refused in one line."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from benchmarks.written_files import write_frf

import jointbayes as jb
from jointbayes.inference import LogPosterior
from tests.case.refusal_rows import case_text_named
from tests.conftest import edited
from tests.frf.test_measured_body import LINES, frfs_of, spindle
from vibrecords import FrfSet, MeasuredFile

TEXT = case_text_named("measured_spindle")


def write_measurements(folder: Path) -> None:
    """The files that the case names."""
    body = frfs_of(spindle(), ("s5:y", "s4:y"), "accelerance")
    turned = body.values * np.array([[1.0, -1.0], [-1.0, 1.0]])  # the sensor at the back points down
    labels = ("5:y", "4:y")
    write_frf(FrfSet(LINES, turned, labels, labels, "accelerance"), folder / "spindle.uff", "uff58")
    tip = FrfSet(LINES, np.ones((len(LINES), 1, 1)) * (1e-3 + 1e-4j), ("7:y",), ("7:y",), "accelerance")
    write_frf(tip, folder / "tip.uff", "uff58")


@pytest.fixture(scope="module")
def directory(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("spindle")
    write_measurements(folder)
    return folder


def case_of(directory: Path, *changes: tuple[str, str]) -> jb.Case:
    path = directory / "case.toml"
    path.write_text(edited(TEXT, *changes), encoding="utf-8")
    return jb.load_case(path)


def test_a_body_is_read_through_its_channels_and_rotations(directory):
    case = case_of(directory)
    assert isinstance(case.problem.test.structure, jb.Substructures)
    assert isinstance(case.problem.log_posterior, LogPosterior)
    (body,) = case.problem.test.measured_bodies
    assert (body.name, body.dofs) == ("spindle", ("nose:y", "nose:rz"))
    exact = frfs_of(spindle(), ("s4:y", "s5:y")).values
    turn = np.array([[0.0, 1.0], [-1 / 0.0625, 1 / 0.0625]])
    want = turn @ exact @ turn.T
    size = np.sqrt(np.abs(want[:, [0, 1], [0, 1]]))
    assert (np.abs(body.receptance - want) / (size[:, :, None] * size[:, None, :])).max() < 1e-5
    assert case.problem.test.structure.propagate
    assert case.problem.test.joint_frf is None
    content = (directory / "spindle.uff").read_bytes()
    assert body.files == (MeasuredFile("spindle.uff", len(content), hashlib.sha256(content).hexdigest()),)


def test_the_noise_of_a_body_may_be_ignored_and_the_workshop_problem_keeps_the_body(directory):
    case = case_of(directory, ('file = "spindle.uff"', 'file = "spindle.uff"\npropagate = false'))
    assert case.problem.test.ignores_noise_of_bodies
    assert case.workshop_problem.test.measured_bodies == case.problem.test.measured_bodies


def test_a_sensor_off_the_joint_is_stated_by_the_joints_offset(directory):
    moved = case_of(
        directory,
        ('against = ["nose:y", "nose:rz"]', 'against = ["nose:y", "nose:rz"]\noffset_against_mm = [20, 0, 0]'),
    )
    here = case_of(directory)
    theta = here.problem.prior.mean[None]
    assert moved.problem.log_posterior(theta) != here.problem.log_posterior(theta)
    (body,) = here.problem.test.measured_bodies
    link = body.seen_at({"nose:y": {"nose:y": 1.0, "nose:rz": 0.02}, "nose:rz": {"nose:rz": 1.0}})
    by_hand = here.problem.with_test(structure=jb.Substructures(here.problem.test.structures, (link,)))
    assert moved.problem.log_posterior(theta) == pytest.approx(by_hand.log_posterior(theta), rel=1e-9)
