"""What tests of all rooms hold code against, and data with stated noise."""

import numpy as np
from numpy.testing import assert_allclose

from vibrecords import FrfData, FrfSet


def noisy_frfs(exact, ports, seed=1, relative=0.02, floor=0.01):
    """FRFs with normal noise in both parts, of a fraction of |H| and of its median, with the variance that this is."""
    rng = np.random.default_rng(seed)
    sd = relative * np.abs(exact) + floor * np.median(np.abs(exact))
    values = exact + sd * (rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape))
    return FrfData(FrfSet(ports.frequency_hz, values, ports.outputs, ports.inputs), 2 * sd**2)


def differences(function, at, step=1e-5):
    """Central differences along each of d coordinates, shape (d, …), at one point (d,) or at many (…, d)."""
    moves = step * np.eye(np.shape(at)[-1])
    return np.array([(function(at + move) - function(at - move)) / (2 * step) for move in moves])


def off_peak(found, exact, axis=0):
    """Largest deviation along an axis over the peak along it, of the worst FRF."""
    return (np.abs(found - exact).max(axis=axis) / np.abs(exact).max(axis=axis)).max()


def check_coordinates(coordinates, theta, rtol=1e-7, of_volume=1e-5):
    """Hold a system of coordinates at points (n, d): there and back, and the volume of its inverse by differences."""
    phi = coordinates.forward(theta)
    back, inside = coordinates.inverse(phi)
    assert inside.all()
    assert_allclose(back, theta, rtol=rtol, atol=rtol)
    slopes = np.moveaxis(differences(lambda at: coordinates.inverse(at)[0], phi), 0, -1)
    assert_allclose(coordinates.log_volume(theta), np.linalg.slogdet(slopes)[1], atol=of_volume)


def check_density(density, theta, rtol=1e-5, step=1e-4):
    """Hold a log posterior at a point: its gradient, and the Jacobian of residuals e, with ln p = constant − eᵀe/2."""
    gradient, (residual, jacobian) = density.gradient(theta), density.residuals(theta)
    slope, columns = (
        (4 * differences(of, theta, step) - differences(of, theta, 2 * step)) / 3
        for of in (lambda at: density(at)[0], lambda at: density.residuals(at)[0])
    )
    assert_allclose(gradient, slope, rtol=rtol, atol=rtol * np.abs(gradient).max())
    assert_allclose(-jacobian.T @ residual, gradient, rtol=1e-8, atol=1e-8 * np.abs(gradient).max())
    assert (np.abs(jacobian - columns.T).max(axis=0) < rtol * np.abs(jacobian).max(axis=0)).all()
