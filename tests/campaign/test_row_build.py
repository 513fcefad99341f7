"""The build that rows come from: it covers all that a row depends on, and rows of two builds never mix."""

import re
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from campaign import row_build
from campaign.coordinator.submit import reuse_rows, submit
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.messages import CampaignAddress, WrongBuild
from campaign.worker.row import open_campaign
from clearcap.cli import app
from engine.platform.build import hash_sources
from tests.campaign import fake_engine
from tests.campaign.driving import computed
from tests.house import ROOT, imports, modules

EARLIER = Path(__file__).parent / "earlier_plans" / "old-b2ff31c7a0"  # 12 of 12 rows, written before builds of rows
COMPUTE_ROWS = ("campaign.worker.row", "campaign.worker.batch")
CARRY_ROWS = re.compile(
    r"campaign\.store(\..*)?|campaign(\.compiling|\.errors|\.processes|\.safe_path)?"
)  # see the docstring of `row_build`


def test_all_that_a_row_depends_on_is_covered():
    """Every module of campaign that those which compute rows import is in the build, or carries rows only."""
    known, waiting = set(), [*COMPUTE_ROWS, "campaign.inputs.sampling"]
    while waiting:
        module = waiting.pop()
        if module not in known:
            known.add(module)
            waiting += [*imports(module), *filter(None, [module.rpartition(".")[0]])]
    files = {
        module: modules()[module].relative_to(ROOT / "campaign") for module in known if module.startswith("campaign")
    }
    assert len(files) > 40
    shared = {i for m in modules() if m.startswith("reporting.distributions") for i in imports(m)}
    assert {m for m in shared if not m.startswith("reporting.distributions")} == {"reporting.arrays"}
    uncovered = [m for m, file in files.items() if not {file.as_posix(), file.parts[0]} & set(row_build.SOURCES)]
    assert [module for module in sorted(uncovered) if not CARRY_ROWS.fullmatch(module)] == []


def test_every_source_counts(tmp_path):
    """Another byte, another name, another file: another hash; what is no source of a row does not count."""
    folder = tmp_path / "campaign"
    shutil.copytree(ROOT / "campaign", folder, ignore=shutil.ignore_patterns("__pycache__"))
    before = hash_sources(folder, row_build.SOURCES)
    assert f"campaign {before}, " in row_build.row_build()
    (folder / "coordinator" / "coordinate.py").write_text("")
    assert hash_sources(folder, row_build.SOURCES) == before
    seen = {before}
    for name in ("worker/row.py", "spec/campaign_file.py", "plan.py", "inputs/new.py"):
        with (folder / name).open("a") as file:
            file.write("# another byte\n")
        seen.add(hash_sources(folder, row_build.SOURCES))
    (folder / "inputs" / "new.py").rename(folder / "inputs" / "renamed.py")
    assert len(seen | {hash_sources(folder, row_build.SOURCES)}) == 6


def test_differences_are_named():
    """Which sources and which library: both versions; an ingredient that only one of the builds has."""
    here = row_build.row_build()
    assert row_build.differences(here) == ""
    other = here.replace(f"scipy {version('scipy')}", "scipy 1.2.3").replace("engine ", "engine f")
    told = row_build.differences(f"{other}, blas 3")
    assert f"scipy {version('scipy')} here, 1.2.3 in the plan" in told
    assert re.search("sources of engine ([0-9a-f]+) here, f\\1 in the plan", told)
    assert "blas none here, 3 in the plan" in told
    assert "earlier version" in row_build.differences(row_build.UNKNOWN)


CHANGED = """\
import sys
import campaign
from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.messages import CampaignAddress, WrongBuild
from campaign.worker.row import open_campaign
from tests.campaign import fake_engine

assert campaign.__file__.startswith(sys.argv[1]), campaign.__file__
store = open_store("runs")
(old,) = store.campaigns()
plan = submit(store, load_campaign("demo.toml"), 5, fake_engine.simulate)
print(plan.campaign_id, store.survey(plan).rows)
try:
    open_campaign(CampaignAddress.of(store, store.plan(old), fake_engine.simulate))
except WrongBuild as error:
    print(error)
"""


@pytest.mark.processes
def test_rows_of_a_changed_sampler_do_not_mix_in(tmp_path, campaign, campaign_file):
    """Parts removed, and another clearcap with the same engine: it plans anew, and computes nothing of the old."""
    store, plan = computed(tmp_path / "runs", campaign, 5)
    for batch in (1, 3):
        Path(store.files.path(f"{plan.campaign_id}/parts/part-{batch:06d}.parquet")).unlink()
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "campaign", copy / "campaign", ignore=shutil.ignore_patterns("__pycache__"))
    sampler = copy / "campaign" / "inputs" / "sampling" / "inverse_transform.py"
    sampler.write_text(sampler.read_text().replace("uniforms(inputs.seed,", "uniforms(inputs.seed + 1,"))
    words = [sys.executable, "-P", "-c", f"import sys; sys.path[:0] = {[str(copy), str(ROOT)]}\n{CHANGED}", str(copy)]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    planned, refused = done.stdout.splitlines()
    new, rows = planned.split()
    assert (new != plan.campaign_id, rows) == (True, "0")
    assert re.search(r"another build of clearcap \(sources of campaign [0-9a-f]{16} here, [0-9a-f]{16} in the", refused)
    assert store.survey(plan).missing == [1, 3]


def test_another_library_another_campaign(tmp_path, campaign, campaign_file, monkeypatch):
    """Nor are rows of another scipy reused or mixed in."""
    store, plan = computed(tmp_path, campaign, 10)
    other = row_build.row_build().replace("scipy ", "scipy 9.")
    monkeypatch.setattr("campaign.plan.row_build", lambda: other)
    longer = submit(store, load_campaign(str(campaign_file), samples=64), 10, fake_engine.simulate)
    assert (longer.row_build, store.survey(longer).rows) == (other, 0)
    assert make_plan(campaign).campaign_id != plan.campaign_id
    with pytest.raises(WrongBuild, match=r"scipy .* here, 9\."):
        open_campaign(CampaignAddress.of(store, longer, fake_engine.simulate))


@pytest.fixture
def earlier(tmp_path, monkeypatch):
    """Return a store in the current folder with a campaign that an earlier version computed."""
    shutil.copytree(EARLIER, tmp_path / "runs" / EARLIER.name)
    monkeypatch.chdir(tmp_path)
    return open_store("runs")


def test_an_earlier_campaign_is_read(earlier):
    """Verbs that read rows go on reading those of a plan without a build; a repeated run says what may differ."""
    plan = earlier.plan(EARLIER.name)
    assert (plan.row_build, plan.engine_build, plan.samples) == (row_build.UNKNOWN, "3ff88a7bd9f7f64c", 12)
    assert earlier.plan_header(EARLIER.name).schema.equals(plan.schema, check_metadata=True)
    for verb, *words in (
        ("status",),
        ("list",),
        ("compact",),
        ("report", "--no-excel"),
        ("whatif", EARLIER.name, "--set", "restitution.upper=0.88"),
        ("advise", EARLIER.name),
        ("replay", EARLIER.name, "7"),
        ("resume", "--no-report"),
    ):
        done = CliRunner().invoke(app, [verb, *words])
        expected = 1 if verb in ("whatif", "advise") else 0  # 12 rows are too few for an answer
        assert done.exit_code == expected, (verb, done.output, done.exception)
        assert ("earlier version of clearcap planned it" in done.stderr) == (verb == "replay")


@pytest.mark.slow
def test_an_earlier_campaign_is_not_completed(earlier, campaign):
    """What would compute its missing or failed rows refuses; none of its rows is reused in a new plan."""
    plan = earlier.plan(EARLIER.name)
    Path(earlier.files.path(f"{EARLIER.name}/parts/part-000001.parquet")).unlink()
    for words in (["resume"], ["coordinate", EARLIER.name], ["rerun", EARLIER.name, "--sample", "0"]):
        done = CliRunner().invoke(app, [*words, "--workers", "1"])
        assert isinstance(done.exception, WrongBuild), done.output
        assert "earlier version of clearcap planned it" in str(done.exception)
    assert earlier.survey(plan).missing == [1]
    (Path("again.toml")).write_bytes(Path("runs", EARLIER.name, "campaign.toml").read_bytes())
    new = submit(earlier, load_campaign("again.toml"), 5, fake_engine.simulate)
    assert new.campaign_id != EARLIER.name
    assert reuse_rows(earlier, new) == 0
