"""Densities that a worker can import; beside it nothing, because each worker starts by importing it."""

import os

import numpy as np

from jointbayes.joint import ComplianceCoordinates


def gaussian(theta):
    return -0.5 * np.sum(theta**2, axis=1)


def failing(error, main, theta):
    """Fail in a worker only: the start is looked at by the caller's process."""
    if os.getpid() != main:
        raise error
    return gaussian(theta)


def leaving(main, theta):
    if os.getpid() != main:
        os._exit(3)
    return gaussian(theta)


class GaussianInCompliance:
    """Gaussian with independent coordinates in compliance about the paper's Table 3, as a density over θ."""

    def __init__(self, parametrisation, relative):
        self.coordinates = ComplianceCoordinates(parametrisation)
        self.theta = parametrisation.coordinates([5.05e9, 3.44e7, 1.52e6])
        self.mean = self.coordinates.forward(self.theta[None])[0]
        self.sd = relative * np.abs(self.mean)

    def __call__(self, theta):
        out = np.full(len(theta), -np.inf)
        inside = self.coordinates.parametrisation.feasible(theta)
        z = (self.coordinates.forward(theta[inside]) - self.mean) / self.sd
        out[inside] = -0.5 * np.sum(z**2, axis=1) - self.coordinates.log_volume(theta[inside])
        return out

    @property
    def covariance(self):
        """Of θ, to first order."""
        step = 1e-5 * np.eye(3)
        jacobian = (self.coordinates.forward(self.theta + step) - self.coordinates.forward(self.theta - step)).T / 2e-5
        inverse = np.linalg.inv(jacobian)
        return inverse @ np.diag(self.sd**2) @ inverse.T
