"""What the tests cost: the CPU time of all processes and the twenty dearest tests, printed at the end of a run.

CPU time, not time on the clock: it says the same on a busy machine. A test's own counts the processes that it started
and waited for.
"""

import os
from collections.abc import Iterator

import pytest

#: Name under which a worker tells the process that prints how much CPU time a test took.
_PROPERTY = "cpu_seconds"
_SHOWN = 20


def cpu_seconds() -> float:
    """CPU time of this process and of those it has waited for, s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class Cost:
    """A plugin of pytest that measures in each worker and prints where the reports come together."""

    def __init__(self) -> None:
        self._begun = 0.0
        self._seconds: dict[str, float] = {}

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self) -> Iterator[None]:
        """Remember what had been used before a test."""
        self._begun = cpu_seconds()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
        """Send with the last report of a test what has been used since."""
        if call.when == "teardown":
            item.user_properties.append((_PROPERTY, cpu_seconds() - self._begun))
        return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Collect what a test took."""
        if report.when == "teardown":
            self._seconds[report.nodeid] = next(s for name, s in report.user_properties if name == _PROPERTY)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the dearest tests and the sum over all processes."""
        dearest = sorted(self._seconds.items(), key=lambda test: -test[1])[:_SHOWN]
        terminalreporter.section(f"CPU time: {cpu_seconds():.0f} s in all; the {len(dearest)} dearest tests")
        for name, seconds in dearest:
            terminalreporter.write_line(f"{seconds:8.2f} s  {name}")
        if path := os.environ.get("TEST_COSTS"):
            with open(path, "w", encoding="utf-8") as file:
                file.writelines(f"{seconds:.3f}\t{name}\n" for name, seconds in self._seconds.items())
