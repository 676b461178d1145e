"""What a posterior is asked wrongly is answered in one line that says what is expected, not by NumPy."""

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.posterior.prediction import left_out_of

COUNT = "expected a whole number, 1 or more"
PROBABILITY = "expected a number between 0 and 1, such as 0.95"
LABELS = r'expected labels of DOFs in a sequence, such as \("11:y",\)'


def ports(p, outputs=("5:y",), lines=None):
    frf = p.problem.test.data.frf
    return jb.Ports(frf.frequency_hz if lines is None else lines, outputs, frf.inputs)


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda p: p.predict_frf(probability=95), f"FRF prediction: found probability 95; {PROBABILITY}"),
        (lambda p: p.predict_frf(probability="0.95"), f"found probability '0.95'; {PROBABILITY}"),
        (lambda p: left_out_of(p, probability=95), f"left out: found probability 95; {PROBABILITY}"),
        (lambda p: p.predict_frf(ports(p, ("tip:y",))), "found DOF 'tip:y'; expected one of '1:y' to '5:rz'"),
        (lambda p: p.predict_frf(ports(p, ("5y",))), "found DOF '5y'; expected one of '1:y' to '5:rz'"),
        (lambda p: p.predict_frf("5:y"), r"found as ports '5:y'; expected jb\.Ports\("),
        (lambda p: p.predict_frf(np.arange(9.0)), r"found as ports ndarray; expected jb\.Ports\("),
        (lambda p: ports(p, "5:y"), f"ports: found as outputs '5:y'; {LABELS}"),
        (lambda p: ports(p, (5,)), f"ports: found as outputs tuple; {LABELS}"),
        (lambda p: ports(p, lines="5:y"), "ports: lines in Hz: found no array of real numbers"),
        (lambda p: p.predict_frf(max_draws=0), f"max_draws: found 0; {COUNT}"),
        (lambda p: p.predict_frf(max_draws=-1), f"max_draws: found -1; {COUNT}"),
        (lambda p: p.predict_frf(max_draws=2.5), f"max_draws: found 2.5; {COUNT}"),
        (lambda p: p.unit("k33"), "found parameter 'k33'; expected one of k11, k12, k22"),
        (lambda p: p.interval("k12", "0.95"), f"interval: found probability '0.95'; {PROBABILITY}"),
        (lambda p: p.interval("k12", 1.0), f"interval: found probability 1.0; {PROBABILITY}"),
        (lambda p: p.interval("k12", 0.0), f"interval: found probability 0.0; {PROBABILITY}"),
        (lambda p: p.interval("k12", np.nan), f"interval: found probability nan; {PROBABILITY}"),
        (lambda p: p.interval("k13"), "expected one of k11, k12, k22"),
        (lambda p: p.to_arviz("200"), "to_arviz: found megabytes '200'; expected a number, 0 or more"),
        (lambda p: p.to_arviz(np.nan), "to_arviz: found megabytes nan; expected a number, 0 or more"),
        (lambda p: p.to_arviz(-1), "to_arviz: found megabytes -1; expected a number, 0 or more"),
    ],
)
def test_a_wrong_argument_is_told_in_one_line(cheap_posterior, ask, message):
    with pytest.raises(jb.ModelError, match=message) as error:
        ask(cheap_posterior)
    assert "\n" not in str(error.value)


def test_numbers_of_numpy_are_numbers(cheap_posterior):
    assert cheap_posterior.interval("k12", np.float64(0.5)) == cheap_posterior.interval("k12", 0.5)
    assert cheap_posterior.predict_frf(ports(cheap_posterior, lines=[100.0]), max_draws=np.int64(4)).magnitude.size == 1
