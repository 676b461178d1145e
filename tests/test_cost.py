"""What a run of the tests says it cost."""

from types import SimpleNamespace

from tests.cost import Cost, cpu_seconds


def test_the_dearest_tests_are_named_first_with_their_cpu_time():
    cost, lines = Cost(), []
    for name, seconds in [("cheap", 0.01), ("dear", 12.5)] + [(f"other {i}", 0.1) for i in range(30)]:
        for when in ("setup", "call", "teardown"):
            properties = [("cpu_seconds", seconds)] if when == "teardown" else []
            cost.pytest_runtest_logreport(SimpleNamespace(when=when, nodeid=name, user_properties=properties))
    before = cpu_seconds()
    cost.pytest_terminal_summary(SimpleNamespace(section=lines.append, write_line=lines.append))
    assert float(lines[0].split()[2]) >= int(before)
    assert lines[1] == "   12.50 s  dear"
    assert len(lines) == 21
    assert not any("cheap" in line for line in lines)
