"""Each call of docs/service.md about the rows of a campaign does what the page says."""

from tests.campaign.web.test_accounts_page import ask, commands


def test_calls(computing, explored):
    client, headers = computing
    known = {"AUTH": f"Authorization: {headers('engineer')['Authorization']}", "URL": "https://localhost"}
    known |= {"ID": explored[1], "OTHER": explored[0]}
    lines = commands("Questions to the rows")
    assert len(lines) > 12
    for line in lines:
        answer = ask(client, line, known)
        assert answer.status_code == 200, (line, answer.text)
