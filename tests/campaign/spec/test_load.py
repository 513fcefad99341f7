"""What a campaign file may say, what its variables may aim at, and what its faults sound like."""

import re
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import tomli_w
from pyarrow import csv

from campaign.errors import SpecError
from campaign.plan import Plan, make_plan
from campaign.spec.load import load_campaign
from campaign.spec.named_files import campaign_names
from campaign.worker.row import compute_row, sample_inputs
from engine import simulate
from engine.loop import Cancel
from engine.mechanism import get_value, load_mechanism, set_values
from tests.campaign.conftest import SPEC
from tests.each import each

PAGE = (Path(__file__).parents[3] / "docs" / "campaign.md").read_text()
EXAMPLE = next(code for code in re.findall(r"```toml runnable\n(.*?)```", PAGE, re.S) if '"lever"' in code)


def replaced(path, old, new):
    """Change the file's text once, and return its path as the loader takes it."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return str(path)


FAULTS = {
    "misspelt key": ("samples = 25", "sampels = 25", ["sampels = 25: unknown key", "did you mean 'samples'?"]),
    "missing key": ("samples = 25", "", ["samples: missing; add it"]),
    "no samples": ("samples = 25", "samples = 0", ["samples = 0: must be at least 1"]),
    "samples as text": ("samples = 25", 'samples = "25"', ['samples = "25": must be a whole number']),
    "samples as truth": ("samples = 25", "samples = true", ["samples = true: must be a whole number"]),
    "negative seed": ("seed = 7", "seed = -1", ["seed = -1: must be at least 0"]),
    "path as name": ('name = "demo"', 'name = "../demo"', ['name = "../demo": allowed: up to 60 letters']),
    "newer format": ("format = 1", "format = 2", ["format = 2: must be 1"]),
    "unknown mechanism": ('mechanism = "c60"', 'mechanism = "c61"', ['mechanism = "c61": c61: no such mech', "c60"]),
    "missing file": ('mechanism = "c60"', 'mechanism = "no.toml"', ["no.toml", "cannot be read"]),
    "sd zero": ("std = 0.0175", "std = 0.0", ["variables.J1.std = 0.0: must be greater than 0; increase it"]),
    "sd negative": ("std = 0.0175", "std = -1", ["variables.J1.std = -1: must be greater than 0"]),
    "sd infinite": ("std = 0.0175", "std = inf", ["variables.J1.std = Infinity: must be a finite number"]),
    "sd misspelt": ("std = 0.0175", "sdt = 1.0", ["variables.J1.sdt = 1.0: unknown key", "did you mean 'std'?"]),
    "mean not a number": ("mean = 0.07", "mean = nan", ["variables.J1.mean = NaN: must be a finite number"]),
    "bounds crossed": ("lower = 0.01", "lower = 0.2", ["variables.J1: lower = 0.2 is not below upper = 0.13"]),
    "impossible mean": (
        "mean = 0.07",
        "mean = 9.0",
        ["variables.J1: [lower, upper] = [0.01, 0.13] holds a share of 0 of", "nothing can be drawn"],
    ),
    "unknown distribution": ('"uniform"', '"unifrom"', ['unknown distribution "unifrom"', "mean 'uniform'?"]),
    "no distribution": (
        'distribution = "uniform"',
        "",
        ["variables.preload: its parameters are missing", "name another distribution"],
    ),
    "unknown preset": (
        'mechanism = "c60"',
        'mechanism = "c60"\npreset = "papr"',
        ['preset = "papr": c60: no preset', "did you mean 'paper'?"],
    ),
    "unknown bench": (
        'mechanism = "c60"',
        'mechanism = "c60"\nbench = "trip_pn"',
        ['bench = "trip_pn": c60: no bench', "did you mean 'trip_pin'?"],
    ),
    "number for a variable": (
        "[variables.J1]\n",
        "[variables]\nJ2 = 0.05\n[variables.J1]\n",
        ["variables.J2 = 0.05: must be a table of keys; write {key = value, ...}"],
    ),
    "batch misspelt": (
        "upper = 0.13",
        "upper = 0.13\nbatch = {sise = 9, std = 1e-3}",
        ["J1.batch.sise = 9: unknown key; allowed: size, std; did you mean 'size'?", "J1.batch.size: missing"],
    ),
    "correlation of 1.5": (
        "seed = 7",
        'seed = 7\ncorrelations = [["J1", "preload", 1.5]]',
        ["correlations.0.2 = 1.5: must be less than 1; reduce it"],
    ),
    "correlation without brackets": (
        "seed = 7",
        'seed = 7\ncorrelations = ["J1", "preload", 0.5]',
        ['correlations.0 = "J1": must be a list, each a list [variable, variable, rank correlation]'],
    ),
    "correlation of a stranger": (
        "seed = 7",
        'seed = 7\ncorrelations = [["J1", "prelaod", 0.5]]',
        ["no variable prelaod; allowed: J1, preload; did you mean 'preload'?"],
    ),
    "sampler misspelt": ("seed = 7", 'seed = 7\nsampler = "sobl"', ["sampler = \"sobl\": must be 'random', 'lhs'"]),
    "one level": (
        "seed = 7",
        'seed = 7\nsampler = "grid"\ngrid = {J1 = 1, preload = 5}',
        ["grid.J1: must be a number of levels, 2 to a million, or a list"],
    ),
    "grid miscounted": (
        "seed = 7",
        'seed = 7\nsampler = "grid"\ngrid = {J1 = 3, preload = 5}',
        ["samples = 25: the grid has 15 points; write samples = 15"],
    ),
    "corners miscounted": ("seed = 7", 'seed = 7\nsampler = "worst_case"', ["write samples = "]),
    "unknown joint": ("[variables.J1]", "[variables.J9]", ["variables.J9: does not set a number of c60", "J1, J2"]),
    "unknown target": ('"springs.A3.preload"', '"springs.A3.x"', ["variables.preload: does not set a number of c60"]),
    "clearance of 0": ("lower = 0.01", "lower = 0.0", ["variables.J1: reaches J1 = 0, which c60 refuses", "allowed: "]),
    "clearance negative": ("lower = 0.01", "lower = -0.1", ["reaches J1 = -0.1, which c60 refuses"]),
    "clearance of 1 mm": ("upper = 0.13", "upper = 1.0", ["reaches J1 = 1, which c60 refuses", "allowed: "]),
    "one target twice": ('"springs.A3.preload"', '"joints.J1.radial_clearance"', ["J1 and preload both set joints.J1"]),
    "drawing of a force": (
        'distribution = "uniform"\nlower = 0.9\nupper = 1.0',
        'dimension = "1 ±0.1"\ncpk = 1.0',
        ['variables.preload.dimension = "1 ±0.1": is in mm, as drawings are, but springs.A3.preload is in rad'],
    ),
    "no such class": (
        "mean = 0.07\nstd = 0.0175",
        'fit = "12 H7/g66"\ncpk = 1.0',
        ["variables.J1: g66 at 12 mm: ISO 286 has no grade 66"],
    ),
    "column name taken": (
        "[variables.preload]",
        "[variables.status]",
        ["variables.status: another column of the results has this name"],
    ),
    "unknown response": (
        "[responses.FC-1]",
        "[responses.FC1]",
        ["responses.FC1: c60 has no response of this name", "'FC-1'"],
    ),
    "limits crossed": ("lsl = 9.0", "lsl = 16.0", ["responses.FC-1: lsl = 16 is not below usl = 16"]),
    "half a tolerance": (
        "lsl = 9.0",
        "nominal = 9.0",
        ["responses.FC-1: nominal and tolerance are only valid together"],
    ),
    "limits twice": ("lsl = 9.0", "nominal = 9.0\ntolerance = 1.0", ["responses.FC-1: nominal and tolerance already"]),
    "retry misspelt": (
        "seed = 7",
        "seed = 7\nfailures = {retry = [{stp = 1e-3}]}",
        ["failures.retry.0.stp = 0.001: unknown key; allowed: step, horizon, tolerance; did you mean 'step'?"],
    ),
    "sampler as a number": ("seed = 7", "seed = 7\nsampler = 2", ["sampler = 2: must be 'random', 'lhs'"]),
    "table misspelt": ("[responses.FC-1]", "[response.FC-1]", ["response: unknown key", "'responses'"]),
}


def refusal(path):
    """Return the error of a campaign, after checking that its message is made from its faults."""
    with pytest.raises(SpecError) as refused:
        load_campaign(str(path))
    assert str(refused.value).split("\n  ")[1:] == [str(fault) for fault in refused.value.faults]
    return refused.value


@each("fault", FAULTS)
def test_fault_is_named(campaign_file, fault):
    """Each is one SpecError that names the file, the key, the value, what is allowed; it has the key and its line."""
    old, new, said = FAULTS[fault]
    campaign_file.write_text(SPEC)
    replaced(campaign_file, old, new)
    refused = refusal(campaign_file)
    message = str(refused)
    assert message.startswith(f"campaign {campaign_file}:")
    assert all(words in message for words in said), message
    lines = campaign_file.read_text().splitlines()
    for found in refused.faults:
        assert found.keys or found.text.startswith("correlations, ")
        assert found.text
        assert 1 <= found.line <= len(lines)
        key = found.key.rpartition(".")[2]
        assert found.line == 1 or key in lines[found.line - 1] or key.isdigit() or found.what.startswith("missing")


def test_all_faults_at_once(campaign_file):
    """A user fixes a file in one go: every fault has its line, structural or not."""
    replaced(campaign_file, "std = 0.0175", "std = -1")
    replaced(campaign_file, "samples = 25", "sampels = 25")
    replaced(campaign_file, "[responses.FC-1]", "[responses.FC1]")
    with pytest.raises(SpecError) as caught:
        load_campaign(replaced(campaign_file, '"springs.A3.preload"', '"springs.A3.x"'))
    _, *lines = str(caught.value).splitlines()
    assert len(lines) == 5  # samples are missing, too
    assert len({line.split(":")[0] for line in lines}) == 5


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"samples = = 3", "not TOML"),
        (b"title = '\xff'", "not UTF-8"),
        (b"#" * 1_000_001, "1000001 bytes; allowed: up to 1000000"),
    ],
)
def test_unreadable_file(tmp_path, content, said):
    """A file that is no campaign is refused in one message."""
    path = tmp_path / "x.toml"
    path.write_bytes(content)
    with pytest.raises(SpecError, match=said):
        load_campaign(str(path))


def test_no_file(tmp_path):
    """A missing file and a folder are refused; the shipped campaigns are listed."""
    with pytest.raises(SpecError, match="no such file, and no shipped campaign of that name; shipped: c60"):
        load_campaign(str(tmp_path / "x.toml"))
    with pytest.raises(SpecError, match="cannot be read"):
        load_campaign(str(tmp_path))


def test_overrides(campaign_file):
    """Samples and seed given on the command line replace the file's, and are checked alike."""
    spec = load_campaign(str(campaign_file), samples=3, seed=0).spec
    assert (spec.samples, spec.seed) == (3, 0)
    with pytest.raises(SpecError, match="samples = 0"):
        load_campaign(str(campaign_file), samples=0)


def test_mechanism_beside_the_file(campaign_file, tmp_path, monkeypatch):
    """The path of a mechanism is relative to the campaign file, not to where the user stands."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    (elsewhere / "own.toml").write_text("broken")
    own = load_campaign("c60").mechanism.model_copy(update={"title": "own"})
    text = "format = 1\nname = 'p'\nmechanism = 'own.toml'\nsamples = 1\n"
    variable = "[variables.J1]\ndistribution = 'constant'\nvalue = 0.05\n"
    (tmp_path / "p.toml").write_text(text + variable)
    content = own.model_dump(mode="json", by_alias=True, exclude_none=True)
    (tmp_path / "own.toml").write_text(tomli_w.dumps(content))
    assert load_campaign(str(tmp_path / "p.toml")).mechanism == own


@pytest.mark.parametrize("name", campaign_names())
def test_shipped_campaigns_load(name):
    """What is shipped is sound."""
    assert load_campaign(name).spec.name == name


def test_c60_is_the_papers_campaign():
    """30,850 samples, seven clearances alike; the paper's limits for FC-1, all others labelled as assumed."""
    spec = load_campaign("c60").spec
    assert spec.samples == 30_850
    assert list(spec.variables) == [f"J{i}" for i in range(1, 8)]
    drawn = {(v.distribution, v.mean, v.std, v.lower, v.upper) for v in spec.variables.values()}
    assert drawn == {("truncated_normal", 0.07, 0.0175, 0.01, 0.13)}
    assert spec.responses["FC-1"].limits() == (9.0, 16.0, None)
    others = [response for name, response in spec.responses.items() if name != "FC-1"]
    assert len(others) == 5
    assert all(response.source.startswith("assumption") for response in others)


def test_the_spring_of_the_hypothesis_is_one_more_variable():
    """`c60_spring`: the campaign `c60`, and A3's preload, 1.045 rad with a sigma of 0.038."""
    plain, spring = load_campaign("c60").spec, load_campaign("c60_spring").spec
    assert spring.responses == plain.responses
    assert list(spring.variables)[:7] == list(plain.variables)
    extra = spring.variables["A3_preload"]
    assert (extra.target, extra.mean, extra.std) == ("springs.A3.preload", 1.045, 0.038)


def test_a_campaign_with_a_preset_has_its_values():
    """Also on a bench; the mechanism that is planned has them, so its campaign is another one."""
    plain = load_campaign("c60")
    paper = load_campaign("c60_paper")
    assert paper.mechanism == set_values(plain.mechanism, plain.mechanism.preset("paper"))
    assert paper.spec.variables == plain.spec.variables
    assert paper.spec.responses == plain.spec.responses
    tables = {
        "format": 1,
        "name": "worn",
        "mechanism": "c60",
        "bench": "contact_force",
        "preset": "prototype",
        "samples": 1,
    }
    loaded = load_campaign(tables | {"variables": {"J2": {"distribution": "constant", "value": 0.05}}})
    assert loaded.mechanism.bench == "contact_force"
    assert get_value(loaded.mechanism, "J1") == 0.085


def test_tolerance_says_limits_and_target(campaign_file):
    """Nominal and tolerance give both limits, and the nominal as target."""
    path = replaced(campaign_file, "lsl = 9.0\nusl = 16.0", "nominal = 12.5\ntolerance = 3.5")
    assert load_campaign(path).spec.responses["FC-1"].limits() == (9.0, 16.0, 12.5)


def test_limits_from_a_nominal_are_those_of_the_drawing():
    """2.11 -+ 0.25 is 1.86 to 2.36, not 1.8599999999999999."""
    from campaign.spec.campaign_file import Response

    assert Response(nominal=2.11, tolerance=0.25).limits() == (1.86, 2.36, 2.11)


def test_a_campaign_on_a_bench_has_its_responses_and_targets(campaign_file):
    """What the bench adds is there, what it takes away is not, and its numbers can be varied."""
    path = replaced(campaign_file, 'mechanism = "c60"', 'mechanism = "c60"\nbench = "contact_force"')
    text = campaign_file.read_text()
    campaign_file.write_text(text[: text.index("[responses")] + "[responses.hysteresis]\nusl = 3.0\n")
    loaded = load_campaign(path)
    assert loaded.spec.bench == loaded.mechanism.bench == "contact_force"
    assert "displacement" in loaded.mechanism.responses
    assert "FC-1" not in loaded.mechanism.responses


def test_corners_of_an_unbounded_variable_are_refused(campaign_file):
    """A normal distribution has no ends."""
    text = campaign_file.read_text()
    normal = '[variables.J2]\ndistribution = "normal"\nmean = 0.07\nstd = 0.001\n\n'
    campaign_file.write_text(text.replace("[variables.J1]", normal + "[variables.J1]"))
    path = replaced(campaign_file, "seed = 7", 'seed = 7\nsampler = "worst_case"')
    with pytest.raises(SpecError, match=r"\bJ2\b"):
        load_campaign(path)


CSV = "gap,name,holes\n0.05,a,1\n0.06,b,\n0.07,c,3\n"
EMPIRICAL = '[variables.J1]\ndistribution = "empirical"\nfile = "gaps.csv"\ncolumn = "gap"\n'


def with_variable(path, text):
    """Replace the file's first variable."""
    content = path.read_text()
    path.write_text(content[: content.index("[variables.J1]")] + text + content[content.index("[variables.preload]") :])
    return str(path)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_measured_values_become_part_of_the_campaign(campaign_file, tmp_path, kind):
    """A column is read when the campaign is loaded: its plan needs no file, and its id changes with the values."""
    (tmp_path / "gaps.csv").write_text(CSV)
    if kind == "parquet":
        pq.write_table(csv.read_csv(tmp_path / "gaps.csv"), tmp_path / "gaps.parquet")
    path = with_variable(campaign_file, EMPIRICAL.replace("csv", kind))
    plan = make_plan(load_campaign(path))
    (tmp_path / f"gaps.{kind}").rename(tmp_path / f"elsewhere.{kind}")
    variable = Plan.from_json(plan.to_json()).spec.variables["J1"]
    assert variable.values == (0.05, 0.06, 0.07)
    assert variable.text() == f"one of 3 values of gaps.{kind}, column gap"
    assert variable.file is None
    (tmp_path / "gaps.csv").write_text(CSV.replace("0.07", "0.08"))
    changed = with_variable(campaign_file, EMPIRICAL)
    assert make_plan(load_campaign(changed)).campaign_id != plan.campaign_id


@each(
    ("old", "new", "said"),
    [
        ('"gap"', '"gop"', 'variables.J1.file = "gaps.csv": no column gop; columns: gap, name, holes; did you mean'),
        ('"gap"', '"name"', "column name holds string; it must hold numbers"),
        ('"gap"', '"holes"', "column holes, row 2 of 3: not finite"),
        ("gaps.csv", "no.csv", r'variables.J1.file = "no.csv": no such file'),
        ("gaps.csv", "gaps.xlsx", "its name ends neither in .csv nor in .parquet"),
        ("gaps.csv", "empty.csv", "not csv: Empty CSV file"),
        ("gaps.csv", "text.parquet", "not parquet: "),
        ('column = "gap"', "", "variables.J1: file and column are only valid together"),
        ('"gap"', '"gap"\nlower = 0.2', "none of the 3 values, 0.05 to 0.07, lies in"),
        ('"gap"', '"gap"\nvalues = [0.05]', "values and file cannot be given together"),
    ],
)
def test_unusable_column_is_refused(campaign_file, tmp_path, old, new, said):
    """A file that cannot be drawn from: key, file, what is wrong, what is there."""
    (tmp_path / "gaps.csv").write_text(CSV)
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "text.parquet").write_text("no parquet")
    with pytest.raises(SpecError, match=said):
        load_campaign(with_variable(campaign_file, EMPIRICAL.replace(old, new)))


LIST = 'samples = 2\nsampler = "list"\ntable = {file = "rows.csv"}'


def test_list_reads_a_column_for_each_variable(campaign_file, tmp_path):
    """The user's table becomes part of the campaign; columns that are no variable are left out."""
    (tmp_path / "rows.csv").write_text("preload,id,J1\n0.91,1,0.05\n0.92,2,0.06\n")
    spec = load_campaign(replaced(campaign_file, "samples = 25", LIST)).spec
    assert spec.table.columns == {"J1": (0.05, 0.06), "preload": (0.91, 0.92)}
    assert spec.table.source == "rows.csv"
    with pytest.raises(SpecError, match="samples = 3"):
        load_campaign(str(campaign_file), samples=3)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("preload\n0.91\n", 'table.file = "rows.csv": no column J1; columns: preload'),
        ("preload,J1\n0.91,0.2\n0.92,0.05\n", "table.columns.J1: value 0.2 .number 0. lies outside"),
        ("preload,J1\n0.91,nan\n0.92,0.05\n", "column J1, row 1 of 2: not finite"),
        ("preload,J1,J1\n0.91,0.1,0.1\n", "2 columns J1"),
    ],
)
def test_unusable_table_is_refused(campaign_file, tmp_path, rows, said):
    """A table without a variable's column, with values that its distribution excludes, or with holes."""
    (tmp_path / "rows.csv").write_text(rows)
    with pytest.raises(SpecError, match=said):
        load_campaign(replaced(campaign_file, "samples = 25", LIST))


def test_ends_are_tried_of_batches_and_counts(campaign_file):
    """What a shifted batch, or a count, can reach is tried on the mechanism before anything runs."""
    batched = '[variables.J1]\ndistribution = "normal"\nmean = 0.07\nstd = 1e-4\nbatch = {size = 9, std = 0.02}\n'
    with pytest.raises(SpecError, match=r"variables\.J1: .*J1 = -0\.02"):
        load_campaign(with_variable(campaign_file, batched))
    counted = '[variables.J1]\ndistribution = "poisson"\nrate = 3.0\nstep = 0.01\n'
    with pytest.raises(SpecError, match=r"variables\.J1: .*J1 = 0\b"):
        load_campaign(with_variable(campaign_file, counted))
    listed = '[variables.J1]\ndistribution = "normal"\nmean = 0.07\nstd = 1e-4\n'
    with_variable(campaign_file, listed)
    rows = 'samples = 2\nsampler = "list"\ntable.columns = {J1 = [0.06, 2.0], preload = [0.9, 0.9]}'
    with pytest.raises(SpecError, match=r"variables\.J1: .*J1 = 2\b"):
        load_campaign(replaced(campaign_file, "samples = 25", rows))


def test_levels_without_end_are_refused(tmp_path):
    """Two thousand million levels were made before their number was compared with the samples."""
    path = tmp_path / "grid.toml"
    path.write_text(
        'format = 1\nname = "g"\nmechanism = "bouncing_ball"\nsamples = 8\nsampler = "grid"\ngrid = {e = 2147483648}\n'
        '[variables.e]\ntarget = "contacts.floor.restitution"\ndistribution = "uniform"\nlower = 0\nupper = 1\n'
    )
    with pytest.raises(SpecError, match=r"grid\.e\b"):
        load_campaign(str(path))
    path.write_text(path.read_text().replace("2147483648", "8").replace("upper = 1", "upper = 1e101"))
    with pytest.raises(SpecError, match=r"variables\.e\.upper = 1e\+101"):
        load_campaign(str(path))


@pytest.mark.parametrize(
    ("key", "table"),
    [
        ("variables.preload.batch.size", "[variables.preload.batch]\nsize = NUMBER\nstd = 0.01\n"),
        ("stop.min_samples", "[stop]\nresponse = 'FC-1'\nstatistic = 'cpk'\nhalf_width = 1.0\nmin_samples = NUMBER\n"),
    ],
)
def test_counts_beyond_all_samples_are_refused(campaign_file, key, table):
    """A batch of 2^63 samples ended in an OverflowError while its samples were drawn."""
    text = table.replace("NUMBER", str(2**63))
    campaign_file.write_text(campaign_file.read_text().replace("[responses.FC-1]", text + "\n[responses.FC-1]"))
    with pytest.raises(SpecError) as error:
        load_campaign(str(campaign_file))
    assert f"{key} = 9223372036854775808: must be at most 100000000" in str(error.value)


def test_a_form_can_mark_its_fields(campaign_file):
    """Keys, values, lines: of a key, of a list's entry, of the campaign as a whole, of the file that it names."""
    text = campaign_file.read_text().replace("std = 0.0175", "std = -1").replace("samples = 25", "samples = 0")
    campaign_file.write_text(text.replace("[responses.FC-1]", "[responses.FC-9]"))
    found = {fault.keys: fault for fault in refusal(campaign_file).faults}
    assert {keys: (fault.value, fault.line) for keys, fault in found.items()} == {
        ("samples",): (0, 4),
        ("variables", "J1", "std"): (-1, 10),
        ("responses", "FC-9"): (None, 20),
    }
    assert found["samples",].to_json()["remedy"] == "increase it"
    campaign_file.write_text(text.replace("samples = 0", 'samples = 3\nsampler = "grid"\ngrid = {J1 = 2, preload = 2}'))
    found = {fault.keys: fault.value for fault in refusal(campaign_file).faults}
    assert ("variables", "J1", "std") in found
    campaign_file.write_text(text.replace("= -1", "= 0.01").replace("samples = 0", 'samples = 3\nsampler = "list"'))
    [fault] = refusal(campaign_file).faults
    assert (fault.keys, fault.line) == (("table",), 1)
    (campaign_file.parent / "own.toml").write_text('format = 1\nname = "own"\n[bodies.a]\nmass = -1\n')
    campaign_file.write_text(text.replace('"c60"', '"own.toml"').replace("samples = 0", "samples = 5"))
    fault = next(fault for fault in refusal(campaign_file).faults if fault.keys == ("mechanism",))
    assert (fault.value, fault.line) == ("own.toml", 3)
    assert next(inner.line for inner in fault.within if inner.keys == ("bodies", "a", "mass")) == 4


def campaign(**variables):
    """Return a campaign on the lever with uniform variables: target and ends of each."""
    tables = {
        name: {"target": target, "distribution": "uniform", "lower": lower, "upper": upper}
        for name, (target, lower, upper) in variables.items()
    }
    return {"format": 1, "name": "arms", "mechanism": "lever", "samples": 4, "variables": tables}


def refused(**variables):
    """Return the message with which a campaign is refused."""
    with pytest.raises(SpecError) as caught:
        load_campaign(campaign(**variables))
    return str(caught.value)


def test_the_example_of_the_page_follows_the_lever_rule(tmp_path):
    """Its force on the stop is load * long / short in every sample, and the columns have the parameters' units."""
    path = tmp_path / "arms.toml"
    path.write_text(EXAMPLE)
    loaded = load_campaign(str(path), samples=4)
    plan = make_plan(loaded)
    units = {column["name"]: column["unit"] for column in plan.columns}
    assert (units["long"], units["load"], units["hole"]) == ("mm", "N", "mm")
    for sample, values in sample_inputs(plan, range(4)):
        row = compute_row(plan, simulate, sample, values, 1, Cancel())
        assert row["status"] == "ok", row["message"]
        arms = (values["long"] - values["hole"]) / (values["short"] + values["hole"])
        assert row["force"] == pytest.approx(values["load"] * arms, rel=1e-6)


@each(
    ("variables", "said"),
    [
        (
            {"a": ("parameters.long", 29, 31), "b": ("parameters.long", 29, 31)},
            "variables.b: a and b both set parameters.long; keep one of them",
        ),
        (
            {"a": ("joints.pin.radial_clearance", 0.01, 0.1), "pin": ("pin", 0.01, 0.1)},
            "variables.pin: a and pin both set pin; keep one of them",
        ),
        (
            {"end": ("forces.load.point.x", 29, 31), "arm": ("parameters.long", 29, 31)},
            "variables.end: end sets forces.load.point.x, which follows from parameters.long (long), and arm sets",
        ),
        (
            {"time": ("simulation.horizon", 10, 20)},
            "variables.time: simulation.horizon says how a run is computed, and is the same for all; ",
        ),
        (
            {"stop": ("contacts.stop.b.plane.point.y", -5.0, 0.1)},
            "variables.stop: reaches contacts.stop.b.plane.point.y = -5, which lever refuses: contacts.stop: gap "
            "-5 mm at the start; allowed: >= 0; move the bodies, the features or `offset`; ",
        ),
        ({"pin": ("pin", 0.01, 0.3)}, "or lower its upper end"),
        (
            {"mass": ("parameters.mass", -1.0, 1.0)},
            "variables.mass: reaches parameters.mass = -1, which lever refuses: then bodies.",
        ),
        ({"arm": ("parameters.lnog", 29, 31)}, "did you mean 'parameters.long'?"),
        ({"arm": ("joints.pin.bearing.point.0", 0, 1)}, "did you mean 'joints.pin.bearing.point.x'?"),
        ({"arm": ("joints.pin.bearing.point", 0, 1)}, "inside it: joints.pin.bearing.point.x, "),
        ({"arm": ("bodies.lever.fixed", 0, 1)}, "bodies.lever.fixed: not a single number"),
        ({"arm": ("joints.pin.type", 0, 1)}, "joints.pin.type: not a single number"),
    ],
)
def test_what_is_refused(variables, said):
    """The variable, its end, what is wrong there with figures, and the remedy."""
    assert said in refused(**variables)


def test_values_with_which_parts_do_not_fit_are_allowed_where_they_are_counted():
    """The stop 5 mm inside the lever is an end like any other; a clearance of 0 remains wrong."""
    stop = {"stop": ("contacts.stop.b.plane.point.y", -5.0, 0.1)}
    assert "or count such samples (failures.max_not_assemblable)" in refused(**stop)
    load_campaign(campaign(**stop) | {"failures": {"max_not_assemblable": 0.5}})
    with pytest.raises(SpecError, match="pin"):
        load_campaign(campaign(pin=("pin", 0.0, 0.1)) | {"failures": {"max_not_assemblable": 0.5}})


def test_two_components_of_one_point_do_not_overlap():
    """Nor a parameter and a number that does not follow from it."""
    variables = {f"b{axis}": (f"joints.pin.bearing.point.{axis}", -0.01, 0.01) for axis in "xy"}
    load_campaign(campaign(arm=("parameters.long", 29, 31), **variables))


def test_a_parameter_that_only_a_formula_of_a_response_uses_may_vary(tmp_path):
    """What the variable changes is the response."""
    text = (Path(__file__).parents[3] / "engine/mechanism/library/lever.toml").read_text()
    response = next(iter(load_mechanism("lever").responses))
    scaled = f'\n[responses.scaled]\ntype = "formula"\nformula = "scale * {response}"\n'
    (tmp_path / "own.toml").write_text(text.replace("\nlong = ", "\nscale = 2.0\nlong = ") + scaled)
    load_campaign(campaign(scale=("parameters.scale", 1.0, 3.0)) | {"mechanism": str(tmp_path / "own.toml")})


def test_a_parameter_from_which_nothing_follows_on_a_bench_is_refused(tmp_path):
    """A variable without effect is a mistake; without the bench there is one."""
    bench = '\n[benches.bare]\nwithout = ["forces.load"]\n'
    text = (Path(__file__).parents[3] / "engine/mechanism/library/lever.toml").read_text()
    (tmp_path / "own.toml").write_text(text + bench)
    tables = campaign(load=("parameters.load", 3.0, 5.0)) | {"mechanism": str(tmp_path / "own.toml")}
    load_campaign(tables)
    with pytest.raises(SpecError, match=r"variables\.load.*parameters\.load"):
        load_campaign(tables | {"bench": "bare"})
