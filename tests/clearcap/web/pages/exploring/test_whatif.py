"""The page of what-if: its numbers are the command's, its address is the question, and what samples do not carry."""

import json
import re
from html import unescape
from urllib.parse import parse_qs, urlsplit

import pytest
from typer.testing import CliRunner

from clearcap.cli import app
from clearcap.web.pages.whatif import other_settings, replaced, settings_of, variable_fields
from reporting import format_numbers
from reporting.capability.intervals import cpk_half_width
from tests.clearcap.web.pages.forms import Page

pytestmark = [pytest.mark.processes, pytest.mark.bits]

COSTS = "[variables.J1]\ncost = 1.0\n[variables.preload]\ncost = 2.0\n"


@pytest.fixture
def home(explored):
    return f"/campaigns/{explored[1]}"


def test_page_has_the_numbers_of_the_command(visit, home, explored, computing_service):
    store = computing_service[0].store.url
    words = ["whatif", explored[1], "--set", "J1.std=0.018", "--store", store, "--json"]
    document = json.loads(CliRunner().invoke(app, words).stdout)
    text = visit(f"{home}/whatif", params={"set": "J1.std=0.018"}).text
    shown = re.search(r'data-cpk="FC-1">([^<]+)<', text)[1]
    assert shown == format_numbers.index(document["responses"]["FC-1"]["cpk"]["value"])
    assert 'class="after"' in text
    assert Page(text).form(f"{home}/whatif")["v.J1.std"] == "0.018"


def test_form_leads_to_the_address_of_its_question(visit, home, computing_service, explored):
    """Without scripts by a redirection, with them in the header that replaces the address; unchanged numbers go."""
    form = Page(visit(f"{home}/whatif").text).form(f"{home}/whatif")
    assert form["v.J1.std"] == "0.02"
    fields = {name: text for name, text in form.items() if name.startswith("v.")} | {"v.J1.std": "0.0180"}
    answer = visit(f"{home}/whatif", status=303, params={**fields, "others": "preload.upper=0.999\n"})
    address = f"{home}/whatif?set=J1.std%3D0.0180&set=preload.upper%3D0.999"
    assert answer.headers["location"] == address
    assert 'class="before"' in visit(address).text
    answer = visit(f"{home}/whatif", params={**fields, "preview": "true"}, headers={"HX-Request": "true"})
    assert answer.headers["hx-replace-url"] == f"{home}/whatif?set=J1.std%3D0.0180"
    assert 'id="answer"' in answer.text


def test_what_samples_do_not_carry_is_grey(visit, home, explored, computing_service):
    """With the reason, and for engineers a button to the form of a campaign that tells: Cpk of 1.33 to 5 %."""
    path = f"{home}/whatif?set=preload.upper%3D1.5"
    text = visit(path).text
    assert 'class="card refused"' in text
    link = re.search(r'href="(/campaigns/new\?[^"]+)"', text)[1].replace("&amp;", "&")
    runs = re.search(r"needs ([\d\u202f]+) runs", text)[1].replace("\u202f", "")
    assert link == f"/campaigns/new?from={explored[1]}&set=preload.upper%3D1.5&samples={runs}"
    assert cpk_half_width(1.33, int(runs), 0.95) / 1.33 == pytest.approx(0.05, rel=1e-3)
    words = ["whatif", explored[1], "--set", "preload.upper=1.5", "--store", computing_service[0].store.url, "--json"]
    assert int(runs) == json.loads(CliRunner().invoke(app, words).stdout)["refused"][0]["runs"]
    begun = visit(link).text
    assert "upper = 1.5" in begun
    while_sliding = visit(f"{path}&preview=true").text  # no emulator is asked many times a second
    assert "An emulator of the samples is asked when you let go" in while_sliding
    assert "/campaigns/new?from" not in while_sliding
    assert "when you let go" not in text
    assert f"samples = {runs}" in begun
    assert "/campaigns/new?from" not in visit(path, "viewer").text


def test_wrong_setting_is_said(visit, home):
    text = visit(f"{home}/whatif", params={"set": "J1.std=<b>"}).text
    assert 'class="fault" role="alert"' in text
    assert "<b>" not in text
    assert 'class="before"' in text  # the samples as they are


def test_advice_and_costs(visit, home):
    text = visit(f"{home}/whatif", params={"advice": "true", "costs": COSTS}).text
    assert "Proposed tolerances" in text or 'class="warn"' in text
    assert Page(text).form(f"{home}/whatif")["advice"] == "true"  # the form of sliders keeps what else was asked
    text = visit(f"{home}/whatif", params={"costs": "not toml"}).text
    assert "costs:" in text


def test_advice_is_applied_to_the_sliders(visit, home):
    """By an address that keeps the other settings and the advice, which then stands in the fields."""
    text = visit(f"{home}/whatif", params={"advice": "true", "set": ["J1.std=0.021", "preload.upper=0.999"]}).text
    links = [unescape(link) for link in re.findall(r'class="button quiet" href="([^"]+)" aria-label="Apply', text)]
    assert links
    asked = parse_qs(urlsplit(next(link for link in links if "J1.std" in link)).query)
    assert asked["advice"] == ["true"]
    settings = dict(each.split("=") for each in asked["set"])
    assert len(settings) == len(asked["set"])
    form = Page(visit(next(link for link in links if "J1.std" in link)).text).form(f"{home}/whatif")
    assert {key: form[f"v.{key}"] for key in settings} == settings


def test_summary_has_the_worst_first(visit, home):
    """What stays in sight on a telephone: Cpk as it is and as it would be."""
    text = visit(f"{home}/whatif", params={"set": "J1.std=0.018"}).text
    summary = text.partition('id="summary"')[2].partition("</ul>")[0]
    shown = re.search(r'data-cpk="FC-1">([^<]+)<', text)[1]
    assert f"→ <strong>{shown}</strong>" in summary


def test_settings_of_an_advice_replace_those_of_their_keys():
    asked = ["J1.std=0.02", "J2.std=0.01"]
    assert replaced(asked, ["J1.std=0.03", "J3.std=1"]) == ["J2.std=0.01", "J1.std=0.03", "J3.std=1"]


def test_settings_of_a_form(computing_service, explored):
    """A number that is the campaign's own is no setting, however it is written; what no field shows is kept."""
    plan = computing_service[0].store.plan(explored[1])
    asked = ["J1.std=0.018", 'J1.distribution="normal"']
    fields = variable_fields(plan, asked)
    assert other_settings(fields, asked) == asked[1:]
    given = {"v.J1.std": " 2e-2", "v.J1.mean": "x", "v.preload.lower": "0.91", "v.none.std": "1"}
    assert settings_of(fields, given, "\nA.b=1\n") == ["J1.mean=x", "preload.lower=0.91", "A.b=1"]
    std = next(key for each in fields for key in each.keys if key.setting == "J1.std")
    assert (std.text, std.now) == ("0.018", 0.02)
    assert std.low < std.now < std.high
