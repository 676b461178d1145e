"""The notebooks of the documentation run from their first cell to the last, on the ArviZ that is installed.

`.ci/run` asks both of its Pythons, which have ArviZ 0.23 and 1.x.
"""

import re
import warnings
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[1] / "docs" / "notebooks").glob("*.ipynb"))
#: Of each version of ArviZ, what a notebook asks of it.
ASKED = {
    False: ["az.loo(", "az.plot_ppc(", "az.plot_trace(", "az.plot_rank(", "az.psens("],
    True: ["az.loo(", "az.plot_ppc_dist(", "az.plot_trace_dist(", "az.plot_rank(", "az.psense_summary("],
}


@pytest.mark.docs
@pytest.mark.version
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, monkeypatch):
    nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed: no notebook is run")
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed: no notebook is run")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed: no notebook is run")
    monkeypatch.setenv("PYTHONWARNINGS", "ignore")
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(path.parent)}}
    ).execute()
    kinds = {}
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert cell.execution_count
            kinds[cell.source] = {kind for output in cell.outputs for kind in output.get("data", {})}
    for source, shown in kinds.items():
        if re.search(r"plot_", source):
            assert "image/png" in shown, source
    assert "text/html" in kinds["posterior.summary()"]
    for name in ("plot_frf", "plot_residuals", "plot_intervals", "plot_corner", "plot_profiles", "plot_traces"):
        assert any(f"jb.{name}(" in source for source in kinds), name
    for calls in ASKED.values():
        assert [call for call in calls if not any(call in source for source in kinds)] == []


def test_notebooks_are_kept_without_what_they_print():
    assert NOTEBOOKS
    for path in NOTEBOOKS:
        text = path.read_text(encoding="utf-8")
        assert '"outputs": []' in text
        assert not re.search(r'"outputs": \[\n|"execution_count": \d', text), path.name


@pytest.mark.whole
def test_arviz_draws_traces_of_at_most_a_thousand_draws_a_chain(cheap_posterior):
    import arviz as az
    from matplotlib import pyplot

    pyplot.switch_backend("Agg")
    data = cheap_posterior.to_arviz(megabytes=5)
    sizes = data.posterior.sizes  # a chain is an ensemble: the draws of all its walkers, which take half a minute
    assert sizes["draw"] <= 1000 < len(cheap_posterior.theta) / sizes["chain"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        az.plot_trace(data, var_names=["k11", "k12", "k22"])
    pyplot.close("all")
