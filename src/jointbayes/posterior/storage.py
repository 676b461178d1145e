"""A posterior as xarray groups and as a netCDF file."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet
from jointbayes.identification import LocalMode, MapEstimate, SearchEffort, StartOutcome
from jointbayes.inference import Problem
from jointbayes.measurement import FrequencyMeasurement, FrfMeasurement, Measurement
from jointbayes.measurement.provenance import Provenance
from jointbayes.sampling import Draws
from jointbayes.whole_file import write_whole_file

__all__ = [
    "StoredPosterior",
    "draws_tree",
    "estimate_from",
    "estimate_record",
    "read_record",
    "stored_measurement",
    "write_tree",
]

#: Of the file: raised when an older reader would misread it, as one that looks for no stored problem.
FILE_VERSION = 2
_ATTRIBUTE = "jointbayes"
_JOINT_FRF = "joint_frf"

Array = NDArray[np.float64]
StoredPosterior = tuple[xr.DataTree, dict[str, Any]]


def draws_tree(problem: Problem, draws: Draws, prior_theta: Array) -> xr.DataTree:
    """Groups posterior, sample_stats, prior and observed_data from draws of θ."""
    posterior = _values_dataset(problem, draws.theta)
    posterior = posterior.assign_coords(ensemble=("chain", draws.ensemble))
    stats = xr.Dataset({"lp": (("chain", "draw"), draws.log_density)}, coords=posterior.coords)
    groups = {
        "/posterior": posterior,
        "/sample_stats": stats,
        "/prior": _values_dataset(problem, prior_theta[None]),
        "/observed_data": _observed(problem.measurement),
    }
    if problem.measurement.provenance is not None and problem.measurement.joint_frf is not None:
        groups[_JOINT_FRF] = _frf_dataset(problem.measurement.joint_frf)  # the files may be gone later
    return xr.DataTree.from_dict(groups)


def _values_dataset(problem: Problem, theta: Array) -> xr.Dataset:
    """Stiffnesses, and values of whatever else is uncertain, from θ of shape (chains, draws, d)."""
    prior = problem.prior
    stiffness, values = prior.stiffness(theta), prior.nuisance_values(theta)
    units = [(q.name, q.unit) for q in problem.quantities] + [(n.name, n.unit) for n in prior.nuisances]
    columns = np.concatenate([stiffness, values], axis=-1)
    variables = {name: (("chain", "draw"), columns[..., i], {"units": unit}) for i, (name, unit) in enumerate(units)}
    chains, draws = theta.shape[:2]
    return xr.Dataset(variables, coords={"chain": np.arange(chains), "draw": np.arange(draws)})


def _observed(measurement: Measurement) -> xr.Dataset:
    if not isinstance(measurement, FrfMeasurement):
        mode = np.arange(1, measurement.frequency_hz.size + 1)
        return xr.Dataset(
            {
                "natural_frequency": ("mode", measurement.frequency_hz, {"units": "Hz"}),
                "natural_frequency_sd": ("mode", measurement.sd_hz, {"units": "Hz"}),
            },
            coords={"mode": mode},
        )
    observed = _frf_dataset(measurement.frf)
    observed["frf_variance"] = (_FRF_DIMS, measurement.variance)
    return observed.assign_attrs(synthetic=int(measurement.synthetic))


_FRF_DIMS = ("frequency", "output", "input")


def _frf_dataset(frf: FrfSet) -> xr.Dataset:
    return xr.Dataset(
        {"frf_real": (_FRF_DIMS, frf.values.real), "frf_imag": (_FRF_DIMS, frf.values.imag)},
        coords={"frequency": frf.frequency_hz, "output": list(frf.outputs), "input": list(frf.inputs)},
        attrs={"quantity": frf.quantity},
    )


def _frf_from(dataset: xr.Dataset) -> FrfSet:
    values = dataset["frf_real"].values + 1j * dataset["frf_imag"].values
    outputs, inputs = (tuple(str(label) for label in dataset[side].values) for side in ("output", "input"))
    return FrfSet(dataset["frequency"].values, values, outputs, inputs, dataset.attrs["quantity"])


def stored_measurement(tree: xr.DataTree, provenance: Mapping[str, Any] | None) -> Measurement | None:
    """Data from measurement files as a posterior keeps them; None where its data came from elsewhere.

    Parameters
    ----------
    tree
        Groups of the posterior.
    provenance
        What its run record says of the files.
    """
    if provenance is None:
        return None
    observed, known = tree["observed_data"].to_dataset(), Provenance.from_json(provenance)
    if "natural_frequency" in observed:
        frequency, sd = observed["natural_frequency"].values, observed["natural_frequency_sd"].values
        return FrequencyMeasurement(frequency, sd, known)
    joint_frf = _frf_from(tree[_JOINT_FRF].to_dataset()) if _JOINT_FRF in tree.children else None
    variance = observed["frf_variance"].values
    return FrfMeasurement(_frf_from(observed), variance, False, known.variance_dof, joint_frf, known)


def estimate_record(estimate: MapEstimate) -> dict[str, Any]:
    """JSON-ready form of a MAP estimate."""
    return {
        "theta": estimate.theta.tolist(),
        "stiffness": estimate.stiffness.tolist(),
        "covariance": estimate.covariance.tolist(),
        "log_posterior": estimate.log_posterior,
        "starts": [
            {**asdict(start), "start": start.start.tolist(), "stiffness": start.stiffness.tolist()}
            for start in estimate.starts
        ],
        "modes": [
            {
                "theta": mode.theta.tolist(),
                "covariance": mode.covariance.tolist(),
                "log_posterior": mode.log_posterior,
            }
            for mode in estimate.modes
        ],
        "effort": asdict(estimate.effort) if estimate.effort is not None else None,
    }


def estimate_from(record: dict[str, Any]) -> MapEstimate:
    """MAP estimate from what `estimate_record` made of it."""
    starts = tuple(
        StartOutcome(**{**s, "start": np.array(s["start"]), "stiffness": np.array(s["stiffness"])})
        for s in record["starts"]
    )
    theta, stiffness, covariance = (np.array(record[key]) for key in ("theta", "stiffness", "covariance"))
    modes = tuple(
        LocalMode(np.array(m["theta"]), np.array(m["covariance"]), m["log_posterior"])
        for m in record.get("modes", ())  # files of version 0.1 know one mode
    )
    effort = SearchEffort(**record["effort"]) if record.get("effort") else None  # unknown to older files
    return MapEstimate(theta, stiffness, covariance, record["log_posterior"], starts, modes, effort)


def write_tree(tree: xr.DataTree, record: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Write groups and record, whole or not at all; the record goes into one JSON attribute.

    NetCDF knows neither booleans nor dictionaries as attributes. The file is made in memory: where a disk is full,
    the HDF5 library ends the whole process.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    stored = tree.copy()
    stored.attrs = {_ATTRIBUTE: json.dumps({"file_version": FILE_VERSION if "problem" in record else 1, **record})}
    view = stored.to_netcdf(None, engine="h5netcdf")
    assert isinstance(view, memoryview)
    content = bytes(view)
    view.release()  # an error would keep it alive beyond its buffer, and Python complain at its end
    write_whole_file(path, content)


def read_record(path: str | os.PathLike[str]) -> StoredPosterior:
    """Read draws and record from a posterior file.

    Raises
    ------
    MeasurementError
        If the file is missing, is no posterior of this package, or is of a later version.
    """
    file = Path(path)
    remedy = "expected a posterior.nc written by jointbayes; give the path of one"
    if not file.is_file():
        raise MeasurementError(f"{file}: no such file; {remedy}")
    try:
        with xr.open_datatree(file, engine="h5netcdf") as tree:
            loaded = tree.load().copy(deep=True)
            record = json.loads(loaded.attrs[_ATTRIBUTE])
            file_version, *_ = [record[key] for key in ("file_version", "record", "mode", "map")]
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
        raise MeasurementError(f"{file}: found no posterior in it ({type(error).__name__}); {remedy}") from error
    if file_version > FILE_VERSION:
        raise MeasurementError(
            f"{file}: found file version {file_version}; expected {FILE_VERSION} or less; "
            "read it with the jointbayes that wrote it, or a later one"
        )
    loaded.attrs = {}
    return loaded, record
