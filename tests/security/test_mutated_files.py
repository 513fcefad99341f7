"""Ten thousand mutated files of every kind that clearcap reads: the project's own errors, soon, and nothing else.

The mutations are the same in each run. ``CLEARCAP_SECURITY_SEED`` gives others; a failure names its seed.
"""

import io
import json
import logging
import os
import shutil
import signal
import tomllib
import traceback
from contextlib import contextmanager
from random import Random

import numpy as np
import pyarrow as pa
import pytest
import tomli_w
from pyarrow import parquet

from campaign.coordinator.heartbeat import Heartbeat, _before_first
from campaign.coordinator.lease import is_coordinated, lease_holder
from campaign.coordinator.state import state_of
from campaign.errors import CampaignError
from campaign.inputs.sampling import draw
from campaign.plan import Plan, dump_spec, make_plan
from campaign.plan_header import parse_plan
from campaign.spec.load import load_campaign
from campaign.spec.named_files import FolderFiles, ParquetReader, read_columns
from campaign.store import BadPart, open_store
from campaign.store.labels import Labels
from campaign.store.layout import HEARTBEAT, LEASE, STATE, STOPPED
from clearcap.cli.campaigns import _entry
from clearcap.questions.tolerances import read_costs
from clearcap.questions.whatif import changed_variables
from engine import EngineError, load_mechanism, simulate, warm_up
from engine.cad.archive import packed
from engine.cad.occt.answers import measure_distances
from engine.cad.occt.step_assembly import read_assembly
from engine.mechanism import mechanism_from
from engine.preflight.cautions import start_gap_cautions, with_start_gaps
from tests.engine.mechanism.geometry.latch_file import LATCH, latch_file
from tests.house import ROOT
from tests.security.mutations import mutate_bytes, mutate_tables, mutate_text

SEED = os.environ.get("CLEARCAP_SECURITY_SEED") or "1"
LONGEST = 60.0  # s of processor time for one file: a guard against hanging
HANGS = 600.0  # s after which a call that takes no processor time hangs
LIBRARY = ROOT / "engine" / "mechanism" / "library"
MECHANISMS = ("bouncing_ball", "slider_crank", "sphere_roll", "spinning_top", "incline", "clearance_pendulum", "lever")
EARLIER = ROOT / "tests" / "campaign" / "earlier_plans" / "old-b2ff31c7a0"


class TooLong(BaseException):
    """A call took more than its time."""


@contextmanager
def guard():
    """End the block with an error if it takes too long or hangs."""

    def end(number, frame):
        raise TooLong(f"more than {LONGEST} s" if number == signal.SIGPROF else "hangs")

    before = [signal.signal(number, end) for number in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    signal.setitimer(signal.ITIMER_REAL, HANGS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in zip((signal.SIGPROF, signal.SIGALRM), before, strict=True):
            signal.signal(number, handler)


def attack(kind, count, mutate, use):
    """Use ``count`` mutated files; return how many were refused and how many were sound.

    ``mutate(random)`` returns a file's content, ``use(content, number)`` reads it and goes on with what it reads.
    """
    refused = 0
    for number in range(count):
        content = mutate(Random(f"{SEED} {kind} {number}"))
        case, said = f"{kind} {number} of CLEARCAP_SECURITY_SEED={SEED}", None
        try:
            with guard():
                use(content, number)
        except (CampaignError, EngineError) as error:
            said = str(error)
        except BaseException as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            pytest.fail(f"{case}: {error!r} in {place.filename}:{place.lineno}\n{content!r}"[:6000])
        if said is not None:
            refused += 1
            assert said.strip(), f"{case}: an error without a message"
            assert len(said) < 100_000, f"{case}: a message as long as a book"
    print(f"{kind}: {count} files, {refused} refused (CLEARCAP_SECURITY_SEED={SEED})")
    return refused, count - refused


def as_toml(random, text):
    """Return the mutated content of a TOML file."""
    match random.randrange(5):
        case 0:
            return mutate_bytes(random, text.encode())
        case 1 | 2:
            return mutate_text(random, text).encode("utf-8", "replace")
    return tomli_w.dumps(mutate_tables(random, tomllib.loads(text))).encode()


def as_json(random, content):
    """Return the mutated content of a JSON file."""
    match random.randrange(5):
        case 0:
            return mutate_bytes(random, content)
        case 1:
            return mutate_text(random, content.decode()).encode("utf-8", "replace")
    return json.dumps(mutate_tables(random, json.loads(content)), indent=1).encode()


# -- what is attacked ------------------------------------------------------------------------------------------------

HEAD = 'format = 1\nname = "small"\nmechanism = "bouncing_ball"\n'
VARIABLE = '[variables.e]\ntarget = "contacts.floor.restitution"\n'
MASS = '[variables.m]\ntarget = "bodies.ball.mass"\n'
CAMPAIGNS = (
    HEAD
    + """
samples = 200
sampler = "sobol"
header = {author = "a"}
stop = {response = "height", statistic = "cpk", half_width = 0.1, max_samples = 190}
failures = {retry = [{step = 1e-4}, {tolerance = 1e-9}], max_failed = 0.1}
execution = {time_limit = 9.0}
responses.height = {lsl = 0, usl = 1, target = 0.5}
"""
    + f'{VARIABLE}distribution = "normal"\nmean = 0.8\nstd = 0.01\nlower = 0.7\nupper = 0.9\n'
    + f'{MASS}distribution = "beta"\nlower = 0.5\nupper = 2.0\nalpha = 2.0\nbeta = 3.0\n',
    HEAD
    + 'samples = 4\nsampler = "list"\ntable = {columns = {e = [0.2, 0.3, 0.4, 0.5]}}\n'
    + f'{VARIABLE}distribution = "uniform"\nlower = 0.1\nupper = 0.9\n',
    HEAD
    + 'samples = 8\nsampler = "grid"\ngrid = {e = 8}\n'
    + f'{VARIABLE}distribution = "triangular"\nlower = 0\nmode = 0.5\nupper = 1\n',
    HEAD
    + 'samples = 30\nsampler = "random"\ncorrelations = [["e", "m", 0.5]]\n'
    + f'{VARIABLE}distribution = "empirical"\nfile = "x.csv"\ncolumn = "x"\n'
    + f'{MASS}distribution = "normal"\nmean = 1.0\nstd = 0.01\nbatch = {{size = 5, std = 0.01}}\n',
    HEAD
    + 'title = "wear"\nsamples = 30\nsampler = "halton"\nseed = 5\n'
    + f'{VARIABLE}distribution = "weibull"\nscale = 0.1\nshape = 2.0\nupper = 0.9\n',
)


def campaigns(folder, count):
    """Campaign files: what is sound is planned, drawn, and the same when it is written and read again."""
    (folder / "x.csv").write_text("x\n0.5\n0.6\n0.7\n")
    bases = [text for text in CAMPAIGNS if is_sound(folder, text)]
    assert len(bases) >= 4, "most of the campaigns to mutate are unsound"

    def use(content, number):
        path = folder / "campaign.toml"
        path.write_bytes(content)
        campaign = load_campaign(str(path))
        plan = make_plan(campaign)
        if number % 4 == 0:
            assert Plan.from_json(plan.to_json()).to_json() == plan.to_json()
            path.write_text(tomli_w.dumps(dump_spec(campaign.spec)), "utf-8")
            assert make_plan(load_campaign(str(path))).campaign_id == plan.campaign_id
        last = campaign.spec.samples - 1
        for column in draw(campaign.spec, max(last - 1, 0), min(last + 1, 2)).values():
            assert np.isfinite(column).all()
        if number % 100 == 0:
            inputs = {name: float(x[0]) for name, x in draw(campaign.spec, 0, 1).items()}
            a_step_of(campaign.mechanism, {plan.targets[name]: x for name, x in inputs.items()})

    return attack("campaign", count, lambda random: as_toml(random, random.choice(bases)), use)


def is_sound(folder, text):
    """Return whether a campaign file is sound."""
    (folder / "base.toml").write_text(text)
    try:
        load_campaign(str(folder / "base.toml"))
    except CampaignError as error:
        print(error)
        return False
    return True


def a_step_of(mechanism, values):
    """Simulate one step: it ends with a status."""
    step = mechanism.simulation.step
    run = simulate(mechanism, {**values, "simulation.wall_limit": 1.0}, step=step, horizon=step)
    assert run.status in ("ok", "not_at_rest", "not_converged", "diverged", "invalid", "timeout", "jammed")


def mechanisms(folder, count):
    """Mechanism files: what is sound is the same when it is written and read again, and can be simulated."""
    bases = [(LIBRARY / f"{name}.toml").read_text("utf-8") for name in MECHANISMS]
    path = folder / "mechanism.toml"

    def use(content, number):
        path.write_bytes(content)
        mechanism = load_mechanism(path)
        if number % 4 == 0:
            again = mechanism_from(mechanism.model_dump(by_alias=True, exclude_unset=True), "again")
            assert again.digest() == mechanism.digest()
        if number % 10 == 0:
            a_step_of(mechanism, {})

    return attack("mechanism", count, lambda random: as_toml(random, random.choice(bases)), use)


def drawn_mechanisms(folder, count):
    """Mechanism files that name faces of a STEP file: what is sound has a certificate, and is the same in numbers."""
    shutil.copy(LATCH, folder / "latch.step")
    base = latch_file()
    base["cad"]["file"] = "latch.step"
    base["contacts"]["rim"] = {
        "a": {"body": "crank", "arc": {"edge": {"near": [28.5, 0.0, 10.1]}}},
        "b": {"body": "coupler", "hole": {"radius": 2.54, "near": [0.0, 0.0, 2.5]}},
        "friction": 0.1,
    }
    path = folder / "drawn.toml"

    def answer(path, content, question, limits):  # in this process: to start one takes longer than the answer
        if "distances" in question:
            return json.dumps(measure_distances(path, json.loads(json.dumps(question["distances"])))).encode()
        return packed(read_assembly(path, **question["assembly"]))

    def use(content, number):
        path.write_bytes(content)
        mechanism = with_start_gaps(load_mechanism(path))
        assert all(map(str, start_gap_cautions(mechanism)))
        plain = mechanism.model_dump(by_alias=True, exclude_unset=True)
        assert mechanism_from(plain, "again").digest() == mechanism.digest()
        if mechanism.geometry is not None:
            assert all(gap.drawn > 0.0 for gap in mechanism.geometry.gaps.values())

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        patch.setattr("engine.cad.step_reader.ask_occt", answer)
        use(tomli_w.dumps(base).encode(), 0)  # sound before it is mutated: else all files are refused for one reason
        return attack("drawn mechanism", count, lambda random: as_toml(random, tomli_w.dumps(base)), use)


def plans(folder, count):
    """Plans of both formats: a changed one of today's is refused, or says the same in other bytes never."""
    earlier = (EARLIER / "plan.json").read_bytes()
    bases = [earlier, Plan.from_json(earlier.decode()).to_json().encode()]

    def use(content, number):
        try:
            text = content.decode()
        except UnicodeDecodeError:
            return
        header, document = parse_plan(text)
        assert header.schema.names
        assert header.samples == document["spec"]["samples"]
        plan = Plan.from_json(text)
        assert document["format"] == 1 or content == bases[1]
        assert plan.columns == header.columns

    return attack("plan", count, lambda random: as_json(random, random.choice(bases)), use)


def documents(folder, count):
    """State, heartbeat, lease, manifest and end of a campaign: what a store says of itself, to list and status."""
    shutil.copytree(EARLIER, folder / "runs" / EARLIER.name)
    store, name = open_store(str(folder / "runs")), EARLIER.name
    plan = store.plan(name)
    store.record(plan, store.survey(plan).parts.values())
    store.write_json(name, HEARTBEAT, Heartbeat(name, "running", 12, 5, 5, 0, 7, {"ok": 5}, 1.0, 7.0, 1).to_json())
    store.write_json(name, LEASE, {"token": "1", "name": "here", "host": "there", "pid": 1, "started": "5"})
    store.write_json(name, STOPPED, {"samples": 10})
    sound = {each: store.files.read(f"{name}/{each}") for each in (HEARTBEAT, LEASE, STATE, STOPPED, "manifest.json")}

    def mutate(random):
        each = random.choice(list(sound))
        return each, as_json(random, sound[each])

    def use(mutated, number):
        each, content = mutated
        store.files.write(f"{name}/{each}", content)
        try:
            entry = _entry(store, name, Labels(), None)
            assert entry["campaign"] == name
            state_of(store, name)
            is_coordinated(store, name)
            lease_holder(store, name)
            Heartbeat.from_json(store.read_json(name, HEARTBEAT) or {})
            _before_first(store, name)
            assert store.survey(plan).rows <= 12
        finally:
            store.files.write(f"{name}/{each}", sound[each])

    return attack("document", count, mutate, use)


def parts(folder, count):
    """Parts: a sound row is never another one; a changed part is bad."""
    shutil.copytree(EARLIER, folder / "parts" / EARLIER.name)
    store, name = open_store(str(folder / "parts")), EARLIER.name
    plan = store.plan(name)
    table = store.table(name)
    path = f"{name}/parts/part-000001.parquet"
    sound = store.files.read(path)

    def use(content, number):
        store.files.write(path, content)
        try:
            rows = store.read_part(plan, 1)
        except BadPart:
            rows = None
        assert rows is None or content == sound
        survey = store.survey(plan, verify=True)
        assert list(survey.bad) == ([] if content == sound else [1])
        assert store.table(name).equals(table if content == sound else pa.concat_tables([table[:5], table[10:]]))

    return attack("part", count, lambda random: mutate_bytes(random, sound), use)


def data_files(folder, count):
    """CSV and Parquet files: finite numbers, or one message."""
    (folder / "data").mkdir()
    table = pa.table({"x": np.linspace(0, 1, 50), "y": np.arange(50), "s": [f"a{i}" for i in range(50)]})
    text = "x,y,s\n" + "".join(f"{i / 50},{i},a{i}\n" for i in range(50))
    whole = []
    for options in ({"compression": "zstd"}, {"compression": None, "use_dictionary": False}, {"compression": "gzip"}):
        parquet.write_table(table, buffer := io.BytesIO(), row_group_size=20, **options)
        whole.append(buffer.getvalue())

    def mutate(random):
        if random.randrange(2):
            return "x.parquet", mutate_bytes(random, random.choice(whole))
        either = mutate_bytes(random, text.encode()), mutate_text(random, text).encode("utf-8", "replace")
        return "x.csv", random.choice(either)

    def use(mutated, number):
        name, content = mutated
        (folder / "data" / name).write_bytes(content)
        columns = read_columns(FolderFiles(folder / "data"), name, ["x", "y"][: 1 + number % 2], reader)
        for values in columns.values():
            assert np.isfinite(values).all()

    with ParquetReader() as reader:
        return attack("data file", count, mutate, use)


COSTS = "target = 1.33\n[variables.restitution]\nfixed = 1.0\ncost = 0.5\nlower = 0.01\nupper = 0.1\nlocked = false\n"


def costs_and_settings(folder, count):
    """Cost files, and what --set is given."""
    plan = Plan.from_json((EARLIER / "plan.json").read_text())
    path = folder / "costs.toml"

    def mutate(random):
        if random.randrange(2):
            return as_toml(random, COSTS)
        key = random.choice(("upper=0.88", "distribution='normal'", "batch.x=1"))
        return mutate_text(random, f"restitution.{key}")

    def use(content, number):
        if isinstance(content, bytes):
            path.write_bytes(content)
            read_costs(path, plan)
        else:
            changed_variables(plan.spec, [content])

    return attack("costs and settings", count, mutate, use)


KINDS = {
    campaigns: 2500,
    mechanisms: 2600,
    drawn_mechanisms: 400,
    plans: 1000,
    documents: 1200,
    parts: 800,
    data_files: 1000,
    costs_and_settings: 500,
}


@pytest.fixture
def ready():
    """Compile the engine, which takes longer than any file may, and leave out a thousand warnings of bad parts."""
    warm_up()
    logging.disable(logging.WARNING)
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_some_mutated_files(tmp_path, ready, kind):
    """A twentieth of them, in every run of the tests."""
    refused, sound = kind(tmp_path, KINDS[kind] // 20)
    assert refused + sound == KINDS[kind] // 20


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_ten_thousand_mutated_files(tmp_path, ready, kind):
    """All of them, each kind refused now and then and accepted now and then."""
    assert sum(KINDS.values()) == 10_000
    refused, sound = kind(tmp_path, KINDS[kind])
    assert refused > 0 or kind is parts
    assert sound > 0


def test_a_call_that_hangs_is_ended():
    """What takes too long fails: the guard works."""

    def compute():
        signal.setitimer(signal.ITIMER_PROF, 0.05)
        while True:
            pass

    def wait():
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        signal.pause()

    for hang, said in ((compute, "more than"), (wait, "hangs")):
        with pytest.raises(TooLong, match=said), guard():
            hang()


def test_an_error_of_another_kind_is_found():
    """It fails with the seed and the number of the file."""

    def use(content, number):
        raise ZeroDivisionError if number == 3 else CampaignError("refused")

    with pytest.raises(pytest.fail.Exception, match=rf"a kind 3 of CLEARCAP_SECURITY_SEED={SEED}: ZeroDivisionError"):
        attack("a kind", 5, lambda random: b"", use)
