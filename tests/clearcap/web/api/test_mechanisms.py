"""Mechanisms and single runs over the API, computed by a process of the pool."""

import pytest

from engine import load_mechanism, simulate

PENDULUM = "clearance_pendulum"


@pytest.mark.processes
def test_list(computing):
    client, headers = computing
    document = client.get("/api/v1/mechanisms", headers=headers("viewer")).json()
    assert {"c60", PENDULUM} <= set(document["shipped"])


@pytest.mark.processes
def test_show(computing):
    client, headers = computing
    document = client.get(f"/api/v1/mechanisms/{PENDULUM}", headers=headers("viewer")).json()
    assert document["name"] == PENDULUM
    key = document["keys"][0]
    assert {"key", "value", "unit", "limits"} <= key.keys()
    assert client.get("/api/v1/mechanisms/none", headers=headers("viewer")).status_code == 404


@pytest.mark.processes
def test_text(computing):
    client, headers = computing
    answer = client.get(f"/api/v1/mechanisms/{PENDULUM}/text", headers=headers("viewer"))
    assert "[bodies" in answer.text
    assert answer.headers["content-type"] == "application/toml"


@pytest.mark.processes
def test_save_check_and_use(computing):
    client, headers = computing
    text = client.get(f"/api/v1/mechanisms/{PENDULUM}/text", headers=headers("viewer")).text
    engineer = headers("engineer")
    checked = client.post("/api/v1/checks/mechanism", json={"text": text}, headers=engineer).json()
    assert checked["summary"]["bodies"] > 0
    for version in (1, 2):
        answer = client.put("/api/v1/mechanisms/mine", json={"text": text, "version": version - 1}, headers=engineer)
        assert (answer.status_code, answer.json()["version"]) == (200, version)
    assert client.put("/api/v1/mechanisms/mine", json={"text": text, "version": 1}, headers=engineer).status_code == 409
    assert client.put("/api/v1/mechanisms/c60", json={"text": text}, headers=engineer).status_code == 409
    assert client.put("/api/v1/mechanisms/mine", json={"text": text}, headers=headers("viewer")).status_code == 403
    assert client.get("/api/v1/mechanisms/mine/text", headers=headers("viewer")).text == text
    assert client.get("/api/v1/mechanisms", headers=headers("viewer")).json()["saved"] == {"mine": 2}
    run = client.post("/api/v1/simulations", json={"mechanism": "mine"}, headers=engineer).json()
    assert run["status"] == "ok"


@pytest.mark.processes
def test_faults_are_a_problem(computing):
    client, headers = computing
    answer = client.post("/api/v1/checks/mechanism", json={"text": "bodies = 3\n"}, headers=headers("engineer"))
    assert answer.status_code == 422
    assert "bodies" in answer.json()["detail"]


def test_value_without_a_key_that_can_be_written(client, as_user):
    """Half of a letter, as JSON allows it, names nothing."""
    body = b'{"mechanism": "incline", "values": {"\\ud800": 1.0}}'
    headers = {**as_user("engineer"), "Content-Type": "application/json"}
    answer = client.post("/api/v1/simulations", content=body, headers=headers)
    assert (answer.status_code, answer.json()["faults"][0]["keys"][:2]) == (422, ["body", "values"])


@pytest.mark.processes
def test_simulation_has_the_bits_of_the_engine(computing):
    client, headers = computing
    wanted = {"mechanism": PENDULUM}
    answer = client.post("/api/v1/simulations", json=wanted, headers=headers("engineer")).json()
    run = simulate(load_mechanism(PENDULUM), {})
    assert answer["responses"] == run.measured
    assert answer["certificate"]["steps"] == run.certificate.steps


@pytest.mark.processes
@pytest.mark.parametrize(
    "wanted",
    [
        {},
        {"mechanism": "c60", "text": "x"},
        {"mechanism": "c60", "values": {"J99": 0.1}},
        {"mechanism": "c60", "step": -1},
    ],
)
def test_odd_simulation_is_refused(computing, wanted):
    client, headers = computing
    answer = client.post("/api/v1/simulations", json=wanted, headers=headers("engineer"))
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.processes
def test_pictures(computing):
    client, headers = computing
    picture = client.get(f"/api/v1/mechanisms/{PENDULUM}/picture.svg", headers=headers("viewer"))
    assert picture.content.startswith(b"<?xml")
    motion = client.get(f"/api/v1/simulations/{PENDULUM}/motion.gif", headers=headers("engineer"))
    assert motion.content.startswith(b"GIF8")
    tag = motion.headers["etag"]
    again = client.get(
        f"/api/v1/simulations/{PENDULUM}/motion.gif", headers={**headers("engineer"), "If-None-Match": tag}
    )
    assert again.status_code == 304
