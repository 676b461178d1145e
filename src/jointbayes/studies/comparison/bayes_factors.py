"""Bayes factors in words, and the probabilities of models that were equally probable before the data."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["bayes_factor_words", "model_probabilities"]

_GRADES = (
    (2.0, "not worth more than a bare mention"),
    (6.0, "positive"),
    (10.0, "strong"),
)
_STRONGEST = "very strong"


def bayes_factor_words(two_log_b: float) -> str:
    """Grade of the evidence for the better of two models, from twice the natural logarithm of the Bayes factor.

    Parameters
    ----------
    two_log_b
        2 ln B = 2 (ln Z of the better − ln Z of the other), not negative.

    References
    ----------
    Kass, R. E., Raftery, A. E. (1995). Bayes factors. Journal of the American Statistical Association 90(430),
    773-795, section 3.2. DOI 10.1080/01621459.1995.10476572

    Examples
    --------
    >>> bayes_factor_words(0.6), bayes_factor_words(7.2)
    ('not worth more than a bare mention', 'strong')
    """
    return next((words for limit, words in _GRADES if two_log_b <= limit), _STRONGEST)


def model_probabilities(log_z: ArrayLike) -> NDArray[np.float64]:
    """Posterior probability of each model under equal prior probability, shape (n,), from ln Z, shape (n,).

    Examples
    --------
    >>> model_probabilities(np.log([3.0, 1.0])).round(3).tolist()
    [0.75, 0.25]
    """
    values = np.asarray(log_z, dtype=float)
    weight = np.exp(values - values.max())
    return weight / weight.sum()
