"""An export proves who signed which bytes: any other byte, and any forged document, is found."""

import io
import json
import stat
import warnings
import zipfile
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.rsa import generate_private_key
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from campaign.errors import CampaignError, SpecError
from campaign.spec.load import load_campaign
from clearcap.questions import signing
from clearcap.questions.report import report
from clearcap.questions.report_source import report_source, sha256
from clearcap.questions.signing import (
    Head,
    SignedDocument,
    Signoff,
    UnfitArchive,
    check_whole,
    digests_of,
    fingerprint,
    open_archive,
    signed_files,
    signed_names,
    stream_export,
)
from clearcap.questions.verification import recomputed, verify_export
from tests.campaign.commands import clearcap_here
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed

KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))


def signoff(campaign, files, previous=None, signer="ada", key=KEY, **changes):
    """Return a sign-off as it is kept."""
    plan, rows, report = digests_of(files)
    made = Signoff(
        number=1, campaign=campaign, plan=plan, rows=rows, report=report, files=files, signer=signer, role="approver",
        time="2026-11-23T09:00:00Z", comment="as drawn", submitted_by="eva", is_submitter=signer == "eva",
        previous=previous,
    )  # fmt: skip
    document = made.model_copy(update=changes).to_bytes()
    return SignedDocument(document, key.sign(document))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Return a store with a finished campaign and a report, and its plan."""
    folder = tmp_path_factory.mktemp("signed")
    (folder / "demo.toml").write_text(SPEC)
    store, plan = computed(folder / "runs", load_campaign(str(folder / "demo.toml")), 10)
    report(store, plan, kinds=["html", "json"])
    return store, plan


@pytest.fixture(scope="module")
def exported(finished):
    """Return the bytes of an export with two sign-offs."""
    store, plan = finished
    files = signed_files(store, plan)
    first = signoff(plan.campaign_id, files)
    second = signoff(plan.campaign_id, files, sha256(first.document), "eva")
    return export(finished, [first, second])


def export(finished, signed, key=KEY):
    store, plan = finished
    last = sha256(signed[-1].document) if signed else None
    head = Head(
        time="2026-11-23T09:00:00Z", documents=len(signed), newest=last, campaign=plan.campaign_id,
        of_campaign=len(signed), last=last,
    ).to_bytes()  # fmt: skip
    names = signed_names(store, plan)
    of_head = SignedDocument(head, key.sign(head))
    return b"".join(stream_export(store, plan.campaign_id, names, signed, key.public_key(), of_head))


@pytest.fixture
def folder(exported, tmp_path):
    """Return the unpacked export."""
    with zipfile.ZipFile(io.BytesIO(exported)) as archive:
        archive.extractall(tmp_path / "unpacked")
    return tmp_path / "unpacked"


@pytest.fixture
def file(exported, tmp_path):
    """Return the export as a file."""
    (tmp_path / "export.zip").write_bytes(exported)
    return tmp_path / "export.zip"


def faults(path, key=None):
    """Return what is wrong with an export: its faults, or why it is refused."""
    try:
        return verify_export(open_archive(path), key).faults
    except UnfitArchive as error:
        return [str(error)]


def test_whole_export(file, folder, finished):
    """ZIP and folder say the same: two sign-offs, the second by who had submitted the campaign."""
    for path in (file, folder, next(folder.iterdir())):
        proof = verify_export(open_archive(path), fingerprint(KEY.public_key()))
        assert (proof.campaign, proof.faults) == (finished[1].campaign_id, [])
        assert [(s.number, s.signoff.signer, s.signoff.is_submitter) for s in proof.signoffs] == [
            (1, "ada", False),
            (2, "eva", True),
        ]
    names = proof.signoffs[0].signoff.files
    assert {"plan.json", "campaign.toml", "parts/part-000002.parquet", "report/report.html"} <= names.keys()


def test_export_is_not_held_in_memory(finished):
    """It comes file by file."""
    store, plan = finished
    names = signed_names(store, plan)
    chunks = list(stream_export(store, plan.campaign_id, names, [], KEY.public_key()))
    assert len(chunks) == len(names) + 2  # the key, and the directory
    assert zipfile.ZipFile(io.BytesIO(b"".join(chunks))).testzip() is None


@given(data=st.data())
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_one_changed_byte_is_found(folder, data):
    """One byte of any file: the file is named."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    path = data.draw(st.sampled_from(paths))
    content = path.read_bytes()
    at = data.draw(st.integers(0, len(content) - 1))
    changed = bytearray(content)
    changed[at] ^= data.draw(st.integers(1, 255))
    path.write_bytes(changed)
    try:
        found = faults(folder)
        if path.name == "key.pem" and not found:  # what stands around the key may be written in other ways
            assert verify_export(open_archive(folder)).key == fingerprint(KEY.public_key())
            return
    finally:
        path.write_bytes(content)
    named = path.relative_to(next(folder.iterdir())).as_posix().replace(".sig", ".json")
    of_key = path.name == "key.pem" and "the key of signoffs/key.pem did not sign it" in found[0]
    assert of_key or any(named in words for words in found), found


@given(data=st.data())
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_changed_zip_is_found_or_the_same(exported, tmp_path, data):
    """One byte of the ZIP: it is refused, or all that it holds is what was signed."""
    at = data.draw(st.integers(0, len(exported) - 1))
    changed = bytearray(exported)
    changed[at] ^= data.draw(st.integers(1, 255))
    path = tmp_path / "changed.zip"
    path.write_bytes(changed)
    if not faults(path):
        proof = verify_export(open_archive(path))
        with zipfile.ZipFile(path) as archive:
            for name, digest in proof.signoffs[-1].signoff.files.items():
                top = archive.namelist()[0].split("/")[0]
                assert sha256(archive.read(f"{top}/{name}")) == digest


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda c: (c / "report/report.html").unlink(), "report: report/report.html is missing"),
        (lambda c: (c / "report/new.pdf").write_text("x"), "report: report/new.pdf was not signed"),
        (lambda c: (c / "parts/part-000009.parquet").write_text("x"), "rows: parts/part-000009.parquet was not signed"),
        (lambda c: (c / "parts/part-000000.parquet").unlink(), "rows: parts/part-000000.parquet is missing"),
        (lambda c: (c / "stopped.json").write_text('{"samples": 5}'), "rows: stopped.json was not signed"),
        (lambda c: (c / "campaign.toml").write_text("x"), "plan: campaign.toml differs"),
        (lambda c: (c / "signoffs/0001.json").unlink(), "belongs to no sign-off"),
        (lambda c: (c / "signoffs/0003.json").write_text("{}"), "sign-off 3"),
        (lambda c: (c / "signoffs/note.txt").write_text("{}"), "signoffs/note.txt belongs to no sign-off"),
        (lambda c: (c / "signoffs/0002.sig").write_bytes(bytes(64)), "sign-off 2: signoffs/0002.json was changed"),
        (lambda c: (c / "signoffs/0002.sig").write_bytes(bytes(99)), "sign-off 2"),
        (lambda c: (c / "signoffs/key.pem").write_text("x"), "is not a public key"),
        (lambda c: (c / "signoffs/key.pem").unlink(), "signoffs/key.pem is missing"),
        (lambda c: (c / "report/link").symlink_to("/etc/passwd"), "is a link"),
    ],
)
def test_change_is_named(folder, change, fault):
    """Whatever is missing, added or replaced is named."""
    change(next(folder.iterdir()))
    assert fault in " ".join(faults(folder))


def test_report_of_other_rows(finished, tmp_path):
    """A server that signs a report of other rows is found out; before version 0.2 reports did not say of which."""
    store, plan = finished
    name = f"{plan.campaign_id}/report/capability.json"
    content = store.files.read(name)
    store.files.write(name, content.replace(report_source(store, plan)["rows digest"].encode(), b"0" * 64))
    try:
        files = signed_files(store, plan)
        for version, expected in ((2, "was made of another plan or of other rows"), (1, "")):
            (tmp_path / "x.zip").write_bytes(export(finished, [signoff(plan.campaign_id, files, format=version)]))
            found = faults(tmp_path / "x.zip")
            assert bool(found) == bool(expected)
            assert expected in " ".join(found)
    finally:
        store.files.write(name, content)


def test_recomputed(finished, file, tmp_path):
    """The numbers of the report follow from the rows; one that does not is named, with both values."""
    assert recomputed(open_archive(file)) == []
    store, plan = finished
    name = f"{plan.campaign_id}/report/capability.json"
    content = store.files.read(name)
    document = json.loads(content)
    document["responses"][0]["capability"]["mean"] *= 1.001
    document["headline"] = "Every response is capable, says somebody."
    store.files.write(name, json.dumps(document).encode())
    try:
        (tmp_path / "x.zip").write_bytes(export(finished, [signoff(plan.campaign_id, signed_files(store, plan))]))
    finally:
        store.files.write(name, content)
    said = recomputed(open_archive(tmp_path / "x.zip"))
    assert [each.split(" is ")[0] for each in said] == ["headline", "responses[0].capability.mean"]


def test_recomputed_by_another_version(finished, tmp_path):
    """Its sentences and what it does not state are left out; its numbers and verdicts are not."""
    store, plan = finished
    name = f"{plan.campaign_id}/report/capability.json"
    content = store.files.read(name)
    document = json.loads(content)
    document["provenance"]["clearcap"] = "0.0.1"
    document["responses"][0]["capability"]["interval_reason"] = "Other words of the same meaning stood here."
    del document["responses"][0]["capability"]["median"]
    texts = {"older": json.dumps(document)}
    document["responses"][0]["capability"]["std"] *= 2.0
    document["responses"][0]["verdict"] = "something else"
    texts["changed"] = json.dumps(document)
    found = {}
    try:
        for which, text in texts.items():
            store.files.write(name, text.encode())
            path = tmp_path / f"{which}.zip"
            path.write_bytes(export(finished, [signoff(plan.campaign_id, signed_files(store, plan))]))
            found[which] = [words.split(" is ")[0] for words in recomputed(open_archive(path))]
    finally:
        store.files.write(name, content)
    assert found == {"older": [], "changed": ["responses[0].capability.std", "responses[0].verdict"]}


def test_key_of_another_kind(folder):
    """A key that no server has is refused."""
    pem = generate_private_key(65537, 2048).public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    next(folder.rglob("key.pem")).write_bytes(pem)
    assert "another kind" in faults(folder)[0]


def test_first_sign_off_taken_out(finished, tmp_path):
    """The second alone does not pass as the first."""
    store, plan = finished
    files = signed_files(store, plan)
    first = signoff(plan.campaign_id, files)
    second = signoff(plan.campaign_id, files, sha256(first.document))
    for kept in ([second], [second, first], [first, first]):
        (tmp_path / "x.zip").write_bytes(export(finished, kept))
        assert "does not follow the one before" in " ".join(faults(tmp_path / "x.zip"))


def test_forged_documents(finished, tmp_path):
    """Another key, other digests, another campaign, more keys: none passes."""
    store, plan = finished
    files = signed_files(store, plan)
    other = Ed25519PrivateKey.generate()
    good = signoff(plan.campaign_id, files)
    renamed = SignedDocument(good.document.replace(b'"ada"', b'"bob"'), good.signature)
    more = good.document[:-1] + b',"extra":1}'
    elsewhere = signoff("other-0123456789", files, sha256(good.document))
    forgeries = {
        "0001.json was changed": [renamed],
        "the key of signoffs/key.pem did not sign it": [signoff(plan.campaign_id, files, key=other)],
        "its digests are not those of its files": [signoff(plan.campaign_id, files, rows="0" * 64)],
        "extra": [SignedDocument(more, KEY.sign(more))],
        "is of another campaign": [good, elsewhere],
    }
    for fault, signed in forgeries.items():
        (tmp_path / "x.zip").write_bytes(export(finished, signed))
        assert fault in " ".join(faults(tmp_path / "x.zip"))
    (tmp_path / "x.zip").write_bytes(export(finished, [signoff(plan.campaign_id, files, key=other)], other))
    assert faults(tmp_path / "x.zip") == []  # a whole export of somebody else: only the fingerprint tells
    assert "the export has the key" in faults(tmp_path / "x.zip", fingerprint(KEY.public_key()))[0]


def _with_entry(path, name, content=b"x", **fields):
    entry = zipfile.ZipInfo(name)
    for field, value in fields.items():
        setattr(entry, field, value)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(entry, content)


@pytest.mark.parametrize(
    "name",
    [
        "../x",
        "demo/../../x",
        "/etc/x",
        "demo//x",
        "demo/./x",
        "demo\\x",
        "demo/C:x",
        "demo/a\nb",
        "~/x",
        "demo/folder/",
    ],
)
def test_names_that_lead_elsewhere(file, name):
    """They are refused, whatever a program that unpacks would do with them."""
    _with_entry(file, name)
    [fault] = faults(file)
    assert "a name that" in fault


def test_odd_entries(file, finished, monkeypatch):
    """Links, a second file of a name, a second folder, and too much are refused."""
    campaign, content = finished[1].campaign_id, file.read_bytes()

    def refused(name, **fields):
        file.write_bytes(content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a name that is there twice
            _with_entry(file, name, **fields)
        return faults(file)[0]

    assert "has a link" in refused(f"{campaign}/report/x", external_attr=(stat.S_IFLNK | 0o777) << 16)
    assert "'plan.json' twice" in refused(f"{campaign}/plan.json")
    assert "does not hold the folder of one campaign" in refused("other/x")
    assert "a compression that no export has" in refused(f"{campaign}/x", compress_type=zipfile.ZIP_BZIP2)
    file.write_bytes(content)
    monkeypatch.setattr(signing, "MOST_BYTES", 1000)
    assert "allowed: " in faults(file)[0]


def test_bomb(tmp_path, monkeypatch):
    """A file that says it is small and is not ends at what it says."""
    monkeypatch.setattr(signing, "LARGEST", 10**6)
    path = tmp_path / "bomb.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("demo/plan.json", bytes(10**7))
    assert "more than 1000000 bytes" in faults(path)[0]
    content = path.read_bytes().replace((10**7).to_bytes(4, "little"), (10**5).to_bytes(4, "little"))
    path.write_bytes(content)
    archive = open_archive(path)
    with pytest.raises(UnfitArchive):
        archive.read("plan.json", 2**20)


def test_no_export(tmp_path):
    """Another file, an empty folder, and nothing."""
    (tmp_path / "x").write_text("no ZIP")
    assert "cannot be read as a ZIP" in faults(tmp_path / "x")[0]
    (tmp_path / "empty").mkdir()
    assert "is missing" in faults(tmp_path / "empty")[0]
    with pytest.raises(SpecError, match="no such file"):
        open_archive(tmp_path / "nowhere")


def test_command(file, folder, capsys, monkeypatch):
    """It says who signed what and when, and ends with 1 if that is not so."""
    key = fingerprint(KEY.public_key())
    code, output, messages = clearcap_here(capsys, monkeypatch, "verify", file, "--key", key)
    assert (code, messages) == (0, "")
    assert "2026-11-23T09:00:00Z: ada (approver) signed plan, rows and report; submitted by eva" in output
    assert "eva (approver) signed plan, rows and report; who also submitted it" in output
    assert "as drawn" in output
    assert "intact: all " in output
    code, _, messages = clearcap_here(capsys, monkeypatch, "verify", file)
    assert code == 0
    assert "give --key FINGERPRINT" in messages
    next(Path(folder).rglob("report.html")).write_text("<p>Cpk 2.00</p>")
    code, output, messages = clearcap_here(capsys, monkeypatch, "verify", folder, "--key", key, "--json")
    assert code == 1
    assert '"faults": [\n    "signed version differs: report: report/report.html differs"' in output
    assert "report/report.html differs" in messages


def test_only_what_is_whole_is_signed(tmp_path, finished):
    """Missing rows, a damaged part, or no report: nothing to sign."""
    check_whole(*finished)
    (tmp_path / "demo.toml").write_text(SPEC)
    store, plan = computed(tmp_path / "runs", load_campaign(str(tmp_path / "demo.toml")), 10)
    with pytest.raises(CampaignError, match="has no report"):
        check_whole(store, plan)
    part = tmp_path / "runs" / plan.campaign_id / "parts/part-000001.parquet"
    content = part.read_bytes()
    part.write_bytes(content[:100] + b"x" + content[101:])
    with pytest.raises(CampaignError, match="truncated or damaged"):
        check_whole(store, plan)
    part.unlink()
    with pytest.raises(CampaignError, match="1 batches have no rows"):
        check_whole(store, plan)
