"""The page that tries a mechanism, in a browser: its drawing moves, or stands still for who wants that."""

import json

import numpy as np
import pytest

from clearcap.pictures.moving_drawing import path_data
from engine import load_mechanism, simulate
from tests.chromium import needs_axe, needs_chromium

pytestmark = [pytest.mark.slow, pytest.mark.processes, needs_chromium, needs_axe]
ADDRESS = "/mechanisms/c60/try?set=J1=0.05"
DRAWN = """
const paths = (group) => [...group.querySelectorAll("path:not(.holes)")];
const drawn = (group) => Object.fromEntries(paths(group).map((path) => [path.dataset.part, path.getAttribute("d")]));
return [...document.querySelectorAll("[data-body]")].map(drawn);
"""
CLOCK = "return document.querySelector('[data-clock]').textContent"
SLIDER = "return Number(document.querySelector('.player input').value)"


def test_drawing_moves_and_is_moved(user):
    """It plays by itself, and by keyboard; each frame is the outlines at the frame's places."""
    user.open(ADDRESS)
    first = user.browser.execute_script(SLIDER)
    user.until(lambda: user.browser.execute_script(SLIDER) != first, "it moves")
    user.look()
    user.press("Pause", "button")
    slider = user.tab_to("Time", "input")
    slider.send_keys("\ue011")  # Home
    assert user.browser.execute_script(SLIDER) == 0
    assert user.browser.execute_script(CLOCK) == "t = 0.000 ms"
    slider.send_keys("\ue014" * 7)  # right
    assert user.browser.execute_script(SLIDER) == 7
    motion = json.loads(user.browser.find_element("css selector", "[data-motion]").get_attribute("data-motion"))
    _check_drawn(user.browser.execute_script(DRAWN), motion, 7)
    assert slider.get_attribute("aria-valuetext") == f"t = {motion['time'][7]:#.4g} ms"
    user.browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]}
    )
    user.open(ADDRESS)
    last = len(motion["time"]) - 1
    assert user.browser.execute_script(SLIDER) == last
    _check_drawn(user.browser.execute_script(DRAWN), motion, last)
    assert user.tab_to("Play", "button").is_displayed()
    user.browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    user.open(ADDRESS)
    drawings = user.browser.find_elements("css selector", "figure.motion > svg")
    assert [drawing.is_displayed() for drawing in drawings] == [True]
    assert not user.browser.find_element("css selector", ".player").is_displayed()
    assert f"{simulate(load_mechanism('c60'), {'J1': 0.05}).responses['FC-1']:.6g}" in user.text


def _check_drawn(drawn, motion, frame):
    """Check that the paths of the bodies are their polylines at the places of a frame, to the last decimal but one."""
    assert len(drawn) == len(motion["bodies"])
    count = 0
    for paths, body in zip(drawn, motion["bodies"], strict=True):
        place = np.array(body["places"][frame])
        for part, path in paths.items():
            lines = [np.reshape(line, (-1, 3)) @ place[:6].reshape(2, 3).T + place[6:] for line in body["parts"][part]]
            expected = path_data(lines, closed=part == "outline")
            assert path.count("M") == expected.count("M")
            np.testing.assert_allclose(_numbers(path), _numbers(expected), atol=0.11)
            count += len(_numbers(path))
    assert count > 1000


def _numbers(path):
    return [float(word) for word in path.replace("M", " ").replace("L", " ").replace("Z", " ").split()]
