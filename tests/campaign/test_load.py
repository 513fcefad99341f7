"""What a campaign file may say, and what its faults sound like."""

import pytest
import tomli_w

from campaign.errors import SpecError
from campaign.load import campaign_names, load_campaign


def replaced(path, old, new):
    """Change the file's text once, and return its path as the loader takes it."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return str(path)


FAULTS = {
    "misspelt key": (
        "samples = 25",
        "sampels = 25",
        ["sampels = 25: unknown key", "did you mean 'samples'?"],
    ),
    "missing key": ("samples = 25", "", ["samples: missing; add it"]),
    "no samples": ("samples = 25", "samples = 0", ["samples = 0: must be greater than or equal to 1"]),
    "samples as text": ("samples = 25", 'samples = "25"', ['samples = "25": must be a whole number']),
    "samples as truth": ("samples = 25", "samples = true", ["samples = true: must be a whole number"]),
    "negative seed": ("seed = 7", "seed = -1", ["seed = -1: must be greater than or equal to 0"]),
    "path as name": ('name = "demo"', 'name = "../demo"', ['name = "../demo": allowed: up to 60 letters']),
    "newer format": ("format = 1", "format = 2", ["format = 2: must be 1"]),
    "unknown mechanism": (
        'mechanism = "c60"',
        'mechanism = "c61"',
        ['mechanism = "c61": c61: no such mech', "c60"],
    ),
    "missing file": ('mechanism = "c60"', 'mechanism = "no.toml"', ["no.toml", "cannot be read"]),
    "sd zero": ("std = 0.0175", "std = 0.0", ["variables.J1.std = 0.0: must be greater than 0; enlarge it"]),
    "sd negative": ("std = 0.0175", "std = -1", ["variables.J1.std = -1: must be greater than 0"]),
    "sd infinite": ("std = 0.0175", "std = inf", ["variables.J1.std = Infinity: must be a finite number"]),
    "sd misspelt": ("std = 0.0175", "sdt = 1.0", ["variables.J1.sdt = 1.0: unknown key", "J1.std: missing"]),
    "mean not a number": ("mean = 0.07", "mean = nan", ["variables.J1.mean = NaN: must be a finite number"]),
    "bounds crossed": (
        "lower = 0.01",
        "lower = 0.2",
        ["variables.J1: lower = 0.2 is not below upper = 0.13"],
    ),
    "impossible mean": (
        "mean = 0.07",
        "mean = 9.0",
        ["variables.J1: [0.01, 0.13] begins", "nothing can be drawn"],
    ),
    "unknown distribution": ('"uniform"', '"unifrom"', ['unknown distribution "unifrom"', "mean 'uniform'?"]),
    "no distribution": ('distribution = "uniform"', "", ["variables.preload: no distribution named; add"]),
    "unknown joint": ("[variables.J1]", "[variables.J9]", ["variables.J9: sets no number of c60", "J1, J2"]),
    "unknown target": (
        '"springs.A3.preload"',
        '"springs.A3.x"',
        ["variables.preload: sets no number of c60"],
    ),
    "clearance of 0": (
        "lower = 0.01",
        "lower = 0.0",
        ["variables.J1: reaches J1 = 0, which c60 refuses", "allowed: "],
    ),
    "clearance negative": ("lower = 0.01", "lower = -0.1", ["reaches J1 = -0.1, which c60 refuses"]),
    "clearance of 1 mm": ("upper = 0.13", "upper = 1.0", ["reaches J1 = 1, which c60 refuses", "allowed: "]),
    "one target twice": (
        '"springs.A3.preload"',
        '"joints.J1.radial_clearance"',
        ["J1 and preload both set joints.J1"],
    ),
    "column name taken": ("[variables.preload]", "[variables.status]", ["variables.status: name taken"]),
    "unknown response": ("[responses.FC-1]", "[responses.FC1]", ["responses.FC1: c60 has no such", "'FC-1'"]),
    "limits crossed": ("lsl = 9.0", "lsl = 16.0", ["responses.FC-1: lsl = 16 is not below usl = 16"]),
    "half a tolerance": (
        "lsl = 9.0",
        "nominal = 9.0",
        ["responses.FC-1: nominal and tolerance belong together"],
    ),
    "limits twice": (
        "lsl = 9.0",
        "nominal = 9.0\ntolerance = 1.0",
        ["responses.FC-1: nominal and tolerance already"],
    ),
    "table misspelt": ("[responses.FC-1]", "[response.FC-1]", ["response: unknown key", "'responses'"]),
}


@pytest.mark.parametrize(("old", "new", "said"), FAULTS.values(), ids=FAULTS)
def test_fault_is_named(campaign_file, old, new, said):
    """Each fault is one SpecError that names the file, the key, the value and what is allowed."""
    with pytest.raises(SpecError) as caught:
        load_campaign(replaced(campaign_file, old, new))
    message = str(caught.value)
    assert message.startswith(f"campaign {campaign_file}:")
    assert all(words in message for words in said), message


def test_all_faults_at_once(campaign_file):
    """A user mends a file in one go: every fault has its line, structural or not."""
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
        (b"#" * 1_000_001, "larger than 1 MB"),
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


def test_tolerance_says_limits_and_target(campaign_file):
    """Nominal and tolerance give both limits, and the nominal as target."""
    path = replaced(campaign_file, "lsl = 9.0\nusl = 16.0", "nominal = 12.5\ntolerance = 3.5")
    assert load_campaign(path).spec.responses["FC-1"].limits() == (9.0, 16.0, 12.5)


def test_limits_from_a_nominal_are_those_of_the_drawing():
    """2.11 -+ 0.25 is 1.86 to 2.36, not 1.8599999999999999."""
    from campaign.spec import Response

    assert Response(nominal=2.11, tolerance=0.25).limits() == (1.86, 2.36, 2.11)
