"""The figures of all storms of a session, printed at its end."""

from collections import Counter

COUNTED = "failed", "passed"


def pytest_terminal_summary(terminalreporter):
    """Say which storms there were, what they did, and what came of them."""
    reports = [report for how in COUNTED for report in terminalreporter.getreports(how) if report.when == "call"]
    told = [(report, dict(report.user_properties).get("storm")) for report in reports]
    if not (storms := [figures for _, figures in told if figures]):
        return
    modes = Counter(figures["mode"] for figures in storms)
    drawn = Counter(kind for figures in storms for kind in figures["drawn"])
    hit = Counter(kind for figures in storms for kind, *_ in figures["hits"])
    write = terminalreporter.write_line
    terminalreporter.section(f"{len(storms)} storms")
    write(f"seeds: {' '.join(str(figures['seed']) for figures in sorted(storms, key=lambda f: f['seed']))}")
    write(f"modes: {', '.join(f'{count} {mode}' for mode, count in sorted(modes.items()))}")
    write(f"{'disturbance':<36} {'drawn':>6} {'hit':>6}")
    for kind in sorted(drawn):
        write(f"{kind:<36} {drawn[kind]:>6} {hit[kind]:>6}")
    write(f"{'all':<36} {drawn.total():>6} {hit.total():>6}")
    for what in ("restarts", "take-overs", "told of a take-over"):
        write(f"{what:<36} {sum(figures[what] for figures in storms):>13}")
    seconds = [figures["seconds"] for figures in storms]
    write(f"{'seconds: all, the longest':<36} {sum(seconds):>6.0f} {max(seconds):>6.0f}")
