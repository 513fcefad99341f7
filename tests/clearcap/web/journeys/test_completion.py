"""The editor of a mechanism proposes what the schema allows at a place; it is a text field without scripts."""

import pytest
from selenium.webdriver.common.keys import Keys

from engine.mechanism import mechanism_schema
from tests.chromium import needs_axe, needs_chromium
from tests.clearcap.web.journeys.conftest import browsers
from tests.clearcap.web.journeys.live_server import live_server

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium, needs_axe]
FIELD = "Text of the file, TOML"
EDITOR = "/mechanisms/clearance_pendulum/edit"
OPTIONS = (
    "return [...document.querySelectorAll('.proposals:not([hidden]) [role=option] code')].map((e) => e.textContent)"
)
CHOSEN = """
const id = document.querySelector('textarea').getAttribute('aria-activedescendant');
const option = id && document.getElementById(id);
return option && option.getAttribute('aria-selected') === 'true' ? option.querySelector('code').textContent : null;
"""
READY = "return document.querySelector('textarea').getAttribute('aria-controls')"
STATUS = "return document.querySelector('.editor [role=status]').textContent"
TYPES = next(iter(mechanism_schema()["properties"]["joints"]["patternProperties"].values()))["discriminator"]["mapping"]
PLACES = [
    ("units = |", ['"mm-g-ms"', '"SI"']),
    ("[bodies.arm]\nfixed = |", ["true", "false"]),
    ("[bodies.arm]\n[bodies.base]\n[forces.F]\nbody = |", ['"arm"', '"base"']),
    ("[simulation]\nrest = { window = 1, | }", ["drift"]),
    ('[joints.S]\n|\ntype = "spherical"', ["socket", "ball"]),
    ('[[phases]]\nname = "a"\n\n[[phases]]\n|', ["name", "duration", "until", "damping"]),
    ("[|", ["simulation", "bodies"]),
    ("# a comment |", []),
    ('title = "a text |"', []),
    ("gravity = [|]", []),
]


class Editor:
    """The text field, as somebody types into it.

    Parameters
    ----------
    user : Keyboard
        At the page of the editor.
    """

    def __init__(self, user):
        self._user = user
        user.open(EDITOR)
        user.until(lambda: user.browser.execute_script(READY), "the schema has come")
        self.field = user.tab_to(FIELD)

    def write(self, text):
        """Replace all text, and leave the cursor where | is."""
        before, _, after = text.partition("|")
        self.field.send_keys(Keys.CONTROL, "a")
        self.field.send_keys(Keys.DELETE)
        self.field.send_keys(before + after, Keys.ESCAPE, *[Keys.ARROW_LEFT] * len(after))

    def ask(self):
        """Press Ctrl+Space, and return what is proposed."""
        self.field.send_keys(Keys.CONTROL, Keys.SPACE)
        return self.proposed

    @property
    def proposed(self):
        """What is proposed."""
        return self._user.browser.execute_script(OPTIONS)

    @property
    def chosen(self):
        """What a reader of screens says of it."""
        return self._user.browser.execute_script(CHOSEN)

    @property
    def text(self):
        """All that is written."""
        return self.field.get_property("value")


@pytest.fixture(scope="module")
def somebody(tmp_path_factory):
    """Return somebody who is logged in at a server of his own."""
    with live_server(tmp_path_factory.mktemp("editor"), "--no-drive") as server, browsers(tmp_path_factory) as browser:
        somebody = browser(server.url, 1400)
        somebody.open(server.login)
        yield somebody


@pytest.fixture
def user(somebody):
    """Return him as if he had just come."""
    somebody.begin_anew()
    return somebody


def test_keys_and_values(user):
    """From the first letters to a joint of its own; what was written so far decides what comes next."""
    editor = Editor(user)
    editor.write("")
    editor.field.send_keys("[jo")
    assert (editor.proposed, editor.chosen) == (["joints"], None)
    editor.field.send_keys(Keys.ARROW_DOWN, Keys.ENTER)
    editor.field.send_keys(".J1]", Keys.ENTER)
    assert (editor.text, editor.proposed) == ("[joints.J1]\n", [])
    assert editor.ask()[0] == editor.chosen == "type"
    user.look()
    editor.field.send_keys(Keys.ENTER)
    assert editor.text == "[joints.J1]\ntype = "
    every = {f'"{each}"' for each in TYPES}
    first = editor.ask()
    assert (len(first), set(first) <= every) == (8, True)
    assert user.browser.execute_script(STATUS) == f"1 of {len(every)}"
    editor.field.send_keys(Keys.ARROW_UP)  # from the first to the last
    assert user.browser.execute_script(STATUS) == f"{len(every)} of {len(every)}"
    assert set(first) | set(editor.proposed) == every
    assert editor.chosen == editor.proposed[-1]
    editor.field.send_keys(Keys.ESCAPE, '"clearance_r')
    assert editor.proposed == ['"clearance_revolute"']
    editor.field.send_keys(Keys.ARROW_DOWN, Keys.ENTER, Keys.ENTER)
    assert editor.text == '[joints.J1]\ntype = "clearance_revolute"\n'
    assert editor.ask()[:2] == ["bearing", "journal"]  # of this type, and what must be there first
    assert "ball" not in editor.proposed
    editor.field.send_keys(Keys.ENTER, "{ ")
    assert editor.ask()[:3] == ["body", "point", "axis"]
    editor.field.send_keys(Keys.CONTROL, "z")
    assert "bearing" in editor.text


def test_places(user):
    """In tables, headers, inline tables and lists; nothing in comments, texts and numbers."""
    editor = Editor(user)
    for written, proposed in PLACES:
        editor.write(written)
        found = editor.ask()
        assert found[: len(proposed)] == proposed, written
        assert found or not proposed, written
        if not proposed:
            assert found == [], written
            assert user.browser.execute_script(STATUS) == "No proposals here"
        assert editor.text == written.replace("|", ""), written


def test_nothing_is_lost(user):
    """Tab leaves the field with the proposals; what was written is checked as it stands; without scripts too."""
    editor = Editor(user)
    text = editor.text
    editor.field.send_keys(Keys.CONTROL, Keys.HOME)
    editor.field.send_keys("[jo")
    assert editor.proposed
    user.write("Save as", "mine")
    assert (editor.proposed, editor.text) == ([], f"[jo{text}")
    user.go("Check")
    assert "fault" in user.text
    assert user.browser.find_element("css selector", "textarea").get_property("value") == f"[jo{text}"
    user.browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    user.open(EDITOR)
    field = user.browser.find_element("css selector", "textarea")
    field.send_keys(Keys.CONTROL, Keys.HOME)
    field.send_keys("# mine", Keys.ENTER)
    user.browser.find_element("css selector", "button[value=check]").click()
    user.until(lambda: "No faults" in user.text, "the answer")
    assert field_text(user).startswith("# mine\n")


def field_text(user):
    """Return what the text field holds."""
    return user.browser.find_element("css selector", "textarea").get_property("value")
