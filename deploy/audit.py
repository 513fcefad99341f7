"""Check the locked packages for known vulnerabilities: ``make audit``.

The check fails if a known vulnerability is fixed in a newer version. Packages that could not be checked are reported
clearly but do not fail, because the service may be out of reach.
"""

import json
import subprocess
import sys
import tomllib
from datetime import date
from pathlib import Path
from typing import Any

DEPLOY = Path(__file__).parent
WITHIN = 90  # seconds


def main() -> int:
    """Print the known vulnerabilities of the locked packages; return the exit status."""
    passed_over = tomllib.loads((DEPLOY / "audit.toml").read_text("utf-8")).get("passed_over", [])
    try:
        packages = ask(DEPLOY / "requirements.lock")
    except (OSError, LookupError, ValueError, subprocess.SubprocessError) as error:
        print(f"NOT AUDITED: the service that knows faults of packages gave no answer: {error}")
        return 0
    lines, status = judge(packages, passed_over, date.today())
    print("\n".join(lines))
    return status


def ask(lock: Path) -> list[dict[str, Any]]:
    """Return the report of pip-audit on each package of a lock file; ValueError if it reports nothing."""
    words = ["--disable-pip", "--require-hashes", "--format", "json", "--progress-spinner", "off", "--timeout", "15"]
    command = [sys.executable, "-m", "pip_audit", "--requirement", str(lock), *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=WITHIN, check=False)
    if not done.stdout.strip():
        raise ValueError(next(reversed(done.stderr.strip().splitlines()), f"exit status {done.returncode}"))
    packages: list[dict[str, Any]] = json.loads(done.stdout)["dependencies"]
    return packages


def judge(packages: list[dict[str, Any]], passed_over: list[dict[str, Any]], today: date) -> tuple[list[str], int]:
    """Return a line for each known vulnerability, but for accepted ones until their date, and the exit status."""
    lines, status = [], 0
    for package in packages:
        for fault in package.get("vulns", []):
            names = {fault["id"], *fault.get("aliases", [])}
            what = f"{package['name']} {package['version']}: {fault['id']}"
            known = [each for each in passed_over if each["id"] in names and today <= each["until"]]
            if known:
                lines.append(f"{what} passed over until {known[0]['until']}: {known[0]['reason']}")
            elif fault["fix_versions"]:
                lines.append(f"{what} is fixed in {', '.join(fault['fix_versions'])}: make lock")
                status = 1
            else:
                lines.append(f"{what} is not fixed in any version yet")
    unknown = [package["name"] for package in packages if "skip_reason" in package]
    if unknown:
        lines.append(f"NOT AUDITED: the service knows nothing of {len(unknown)} packages: {', '.join(unknown)}")
    lines.append(f"{len(packages) - len(unknown)} of {len(packages)} locked packages audited")
    return lines, status


if __name__ == "__main__":
    sys.exit(main())
