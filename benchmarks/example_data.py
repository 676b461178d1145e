"""What the examples state or read as data: `python -m benchmarks.example_data` prints it and writes the files.

`tests/test_examples.py` compares what is in `configs/` with what is made here.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

import jointbayes as jb

__all__ = ["TWO_STOREYS", "eigenvalues", "first_shape", "log_normal", "moments", "solutions"]

Array = NDArray[np.float64]

#: The two-storey building of Beck and Au (2002), DOI 10.1061/(ASCE)0733-9399(2002)128:4(380): masses in kg, nominal
#: stiffness of a storey in N/m, measured natural frequencies in Hz, and mode of the prior of k over the nominal one,
#: whose standard deviation is 1.
TWO_STOREYS = {"masses": (16.5e3, 16.1e3), "nominal": 29.7e6, "frequencies": (3.13, 9.83), "modes": (1.3, 0.8)}
#: Mean and standard deviation of k1 over the nominal one that Straub and Papaioannou (2015, DOI
#: 10.1061/(ASCE)EM.1943-7889.0000839) give.
PUBLISHED = {"mean": 1.12, "sd": 0.66}


def eigenvalues() -> Array:
    """Measured eigenvalues ω², rad²/s²."""
    return (2 * np.pi * np.array(TWO_STOREYS["frequencies"])) ** 2


def log_normal(mode: float) -> tuple[float, float]:
    """Median, and standard deviation of the logarithm, of the log-normal of this mode with standard deviation 1."""
    s2 = brentq(lambda s2: (math.exp(s2) - 1) * (mode * math.exp(s2)) ** 2 * math.exp(s2) - 1, 1e-9, 5.0)
    return mode * math.exp(s2), math.sqrt(s2)


def solutions() -> Array:
    """Both pairs (k1, k2) with exactly these eigenvalues, N/m, in the order of k1.

    λ1 + λ2 = (k1 + k2)/m1 + k2/m2 and λ1 λ2 = k1 k2/(m1 m2): a quadratic equation for k2.
    """
    (m1, m2), (low, high) = TWO_STOREYS["masses"], eigenvalues()
    k2 = np.roots([1 + m1 / m2, -m1 * (low + high), m1 * m2 * low * high])
    pairs = np.stack([m1 * m2 * low * high / k2, k2], axis=1)
    return pairs[np.argsort(pairs[:, 0])]


def moments(posterior: jb.Posterior) -> dict[str, float]:
    """Mean and standard deviation of k1 over the nominal one, and the share of draws nearer to the first solution."""
    relative = posterior.stiffness[:, 0] / TWO_STOREYS["nominal"]
    edge = solutions()[:, 0].mean() / TWO_STOREYS["nominal"]
    figures = {"relative_mean": relative.mean(), "relative_sd": relative.std(), "lower_share": (relative < edge).mean()}
    return {name: float(f"{value:.4g}") for name, value in figures.items()}


def first_shape() -> float:
    """Displacement of the lower storey over the upper one's in the first mode, of the softer first storey."""
    (_, m2), (low, _) = TWO_STOREYS["masses"], eigenvalues()
    return float(1 - low * m2 / solutions()[0, 1])


if __name__ == "__main__":
    print("eigenvalues", eigenvalues().round(2).tolist())
    for mode in TWO_STOREYS["modes"]:
        median, sd_log = log_normal(mode)
        print(f"prior: median {median * TWO_STOREYS['nominal']:.5g} N/m, sd_log {sd_log:.5f}")
    print("solutions", solutions().tolist(), "ratio", first_shape())
