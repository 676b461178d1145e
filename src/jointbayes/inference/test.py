"""A test: what was tested in which state, and which of the uncertain quantities are its own."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, singledispatch

import numpy as np

from jointbayes.errors import ModelError, require
from jointbayes.frf import AnyStructure, MeasuredBody, Ports, ReceptanceModel, receptance_model, rigid_body_modes
from jointbayes.frf.measured_body import substructures
from jointbayes.inference.likelihood_base import Likelihood
from jointbayes.inference.noise.base import ErrorSizes, NoiseModel
from jointbayes.inference.noise.model_error import ModelErrorNoise
from jointbayes.joint import AnyJoint, Block, Blocks, Parametrisation, joints_of
from jointbayes.joint.quantities import prefixed
from jointbayes.structure import Body
from vibrecords import Data, FrfSet
from vibrecords.arrays import Indices


@dataclass(frozen=True, eq=False)
class Test:
    """A vibration test: a structure without its joints, where these act, and what was measured.

    Of several tests a quantity of the prior belongs to one where its name begins with the test's, ``"long.length"`` or
    ``"loud.clamp.k22"``, and to all others where it does not: ``"length"``, ``"clamp.k22"``.

    Parameters
    ----------
    name
        Short name; a lone test's may be empty.
    structure
        Body without the joints as it was in this test, or `Substructures` where bodies are given by their measured
        FRFs.
    joints
        Where the joints act; several in a sequence, each with a name; an empty one, ``()``, of a structure that was
        tested free, before it was joined.
    data
        FRFs, natural frequencies or modes with their noise.
    noise
        How residuals of FRFs are distributed; None is Gaussian noise of the variance of the data. A law of
        one's own is a subclass of `NoiseModel`, or of `GaussianSpread` for independent Gaussian values.

    Raises
    ------
    ModelError
        If structure, joints or data are missing.
    """

    __test__ = False  # not a collection of tests of a program, as its name says to pytest

    name: str
    structure: AnyStructure
    joints: AnyJoint
    data: Data
    noise: NoiseModel | None = None

    def __post_init__(self) -> None:
        missing = [name for name in ("structure", "joints", "data") if getattr(self, name) is None]
        if missing:
            found, expected = f"found no {', '.join(missing)}", "structure, joints and data of a test"
            raise ModelError.of("problem", (), found, expected, "pass them, joints=() where nothing is joined")
        body = "a body, such as jb.BeamFamily(jb.BeamRecipe(…), {}); make one"
        require(self.structure, AnyStructure, "problem: found as structure", body)
        require(self.data, Data, "problem: found as data", "data with their noise; of FRFs jb.FrfData(frf, variance)")
        expected = "a noise model of jointbayes.inference, or a subclass of NoiseModel with `parts`"
        require(
            self.noise, NoiseModel | None, "problem: found as noise", expected, lambda n: not n or hasattr(n, "parts")
        )
        object.__setattr__(self, "joints", joints_of(self.joints))

    def with_model_error(self, sizes: ErrorSizes | None) -> "Test":
        """The same with errors of the model in its modes, or without any; itself where its data are FRFs."""
        modes = self.data.modes
        if modes is None:
            return self
        return replace(self, noise=None if sizes is None else ModelErrorNoise.of(modes, sizes))

    def __repr__(self) -> str:
        return f"{f'{self.name}: ' if self.name else ''}{self.structure!r}; {self.data!r}"

    def __str__(self) -> str:
        lines = (
            *([f"test: {self.name}"] if self.name else []),
            f"structure: {self.structure!r}",
            f"joint: {self.joints}",
            f"data: {self.data!r}",
            f"noise: {'Gaussian' if self.noise is None else type(self.noise).__name__}",
        )
        return "\n".join(lines)

    @cached_property
    def structures(self) -> Body:
        """The modelled structures without the joint."""
        return substructures(self.structure).modelled

    @property
    def measured_bodies(self) -> tuple[MeasuredBody, ...]:
        """Bodies given by their measured FRFs; where there are any the assembled structure has no modes."""
        return substructures(self.structure).measured

    @property
    def ignores_noise_of_bodies(self) -> bool:
        """Whether measured bodies are taken for exact, so that intervals are too narrow."""
        whole = substructures(self.structure)
        return bool(whole.measured) and not whole.propagate

    @property
    def joint_frf(self) -> FrfSet | None:
        """FRFs at the joint for the paper's iteration, which needs a structure that is modelled throughout, or None."""
        return None if self.measured_bodies else self.data.joint_frf

    @cached_property
    def structures_of_data(self) -> Body:
        """The modelled structures, exact at the joint and the measured DOFs up to the highest frequency of the data."""
        dofs, modes = (*self.joints.labels, *self.data.dofs), self.data.modes
        top_hz = self.data.top_hz if modes is None else self.structures.reach_hz(max(modes.numbers))
        return substructures(self.structure).at(dofs, top_hz).modelled

    @property
    def most_modes(self) -> int:
        """Natural frequencies that the model of the data has with any joint, also a rigid one; 0 without modes."""
        if self.measured_bodies:
            return 0
        free = self.structures_of_data
        return free.n_dofs - rigid_body_modes(free, self.joints) - self.joints.size

    def receptance_model(self, ports: Ports) -> ReceptanceModel:
        """Forward model for other lines and DOFs.

        Raises
        ------
        ModelError
            If a DOF does not exist.
        """
        return receptance_model(self.structure, self.joints, ports)

    def with_reference(self, *, solved: bool) -> "Test":
        """The same test with much richer elements, see `Body.reference`."""
        body, whole = self.structures.reference(solved=solved), substructures(self.structure)
        return replace(self, structure=replace(whole, modelled=body) if whole.measured else body)


@singledispatch
def likelihood_of(data: Data, test: Test, *, gain: bool = False) -> Likelihood:
    """Return the likelihood of the data of a test; each kind of data registers its own, ``@likelihood_of.register``.

    Parameters
    ----------
    data, test
        The data, and the test that they are from.
    gain
        Whether the measured FRFs may all be off by one factor.

    Raises
    ------
    ModelError
        If a measured DOF does not exist in the structure, there are more modes than DOFs, the data are modes and a
        body is measured, errors of natural frequencies are uncertain that the FRFs do not depend on, or nothing is
        registered for such data.
    """
    found = f"found data of kind {type(data).__name__}"
    raise ModelError.of("likelihood", (), found, "a kind with a likelihood", "register one with likelihood_of.register")


def require_own_bodies(tests: Sequence[Test]) -> None:
    """Refuse a measurement of a body that several tests have.

    Its errors are the same in all of them, and the likelihoods of tests are those of independent data: with its
    noise propagated they would count as averaged, and intervals would be too narrow.

    Raises
    ------
    ModelError
        If two tests have it.
    """
    owners: list[tuple[str, MeasuredBody]] = []
    for test in tests:
        whole = substructures(test.structure)
        bodies = whole.measured if whole.propagate else ()
        for body in bodies:
            lines, frfs = body.frequency_hz, body.receptance
            same = (np.array_equal(b.frequency_hz, lines) and np.array_equal(b.receptance, frfs) for _, b in owners)
            other = next((name for (name, _), is_same in zip(owners, same, strict=True) if is_same), None)
            if other is not None:
                raise ModelError(
                    f"problem: found one measurement of the body {body.name} in tests {other} and {test.name}, with "
                    "one error that would count as one of each; expected a measurement for each test, or one test; "
                    "measure the body again"
                )
        owners += ((test.name, body) for body in bodies)


def own_name(test: str, name: str, names: Iterable[str]) -> str | None:
    """Name of a quantity of a test among `names`: its own where there is one, or else the one for all; or None."""
    among = set(names)
    first = prefixed(test, name) if test else name
    return first if first in among else name if name in among else None


def columns_of_names(test: str, wanted: Sequence[str], names: Sequence[str]) -> Indices:
    """Places of the quantities of a test among `names`.

    Raises
    ------
    ModelError
        If one is not among them.
    """
    own_names = [own_name(test, name, names) for name in wanted]
    missing = [name for name, among_names in zip(wanted, own_names, strict=True) if among_names is None]
    if missing:
        of = f" of test {test}" if test else ""
        found = f"found no prior for {', '.join(missing)}{of}"
        raise ModelError.of("posterior", (), found, f"one for each of {', '.join(wanted)}", "add it")
    return np.array([names.index(name) for name in own_names if name is not None], dtype=np.intp)


def arranged(parametrisation: Parametrisation, tests: Sequence[Test]) -> Parametrisation:
    """The parametrisation with a K^J of the joints of all tests side by side, in their order.

    Parameters
    ----------
    parametrisation
        Of all joints; one that is of several tests once.
    tests
        In their order.

    Raises
    ------
    ModelError
        If a joint has no quantities, or those of a joint of another size.
    """
    blocks = parametrisation.blocks if isinstance(parametrisation, Blocks) else (Block("", parametrisation, (0,)),)
    rows: dict[str, list[int]] = {block.name: [] for block in blocks}
    by_joint = {joint: block for block in blocks for joint in block.joints}
    row = 0
    for test in tests:
        joints = test.joints
        for joint in joints.joints:
            own_joint = prefixed(test.name, joint.name) if joint.name else test.name
            # one set of quantities without a name meets one joint of any name
            lone = blocks[0] if len(blocks) == 1 and not blocks[0].name and len(joints.joints) < 2 else None
            block = by_joint.get(own_joint) or by_joint.get(joint.name) or lone
            if block is None or block.parametrisation.size != joint.size:
                those = "none" if block is None else f"those of {block.parametrisation.size} DOFs"
                raise ModelError(
                    f"problem: found a prior of quantities for {', '.join(map(repr, by_joint))}, and {those} for joint "
                    f"{joint.name or str(joint)!r} with {joint.size} DOFs; expected a parametrisation of each joint; "
                    "make it with `blocks_of` by the joints' names"
                )
            rows[block.name].append(row)
            row += joint.size
    if not isinstance(parametrisation, Blocks) and rows[""] == [0]:
        return parametrisation
    return Blocks(tuple(replace(block, rows=tuple(rows[block.name])) for block in blocks))
