"""Those who use a server in a storm: one posts the campaign and follows it, one makes entries; both come back.

What the server has answered is remembered, to be found again when the storm is over.
"""

import json
import threading
from collections import Counter
from contextlib import suppress
from itertools import count, cycle

import httpx

from clearcap.client.remote_server import events_in

API = "/api/v1"
PAUSE = 0.5  # s, between two tries, and between two entries
SILENCE = 30.0  # s without a word, after which a connection is given up; a server may be paused for half of it
MADE = (200, 201)


class Visitors:
    """Who uses a server.

    Parameters
    ----------
    url : str
        Address of the server.
    headers : dict of str to str
        With an admin's token.
    text : str
        The campaign file.
    campaign : str
        The id that it will have.
    earlier : str
        Id of a completed campaign, for shared links and sign-offs.

    Attributes
    ----------
    events : list of dict
        What the follower of the campaign was told, in this order.
    has_seen_the_end : bool
        Whether he was told that nothing more happens.
    kept : list of (str, str)
        Kind and name of each entry that the server has answered as made.
    statuses : Counter of int
        Of all answers.
    faults : list of str
        Answers that say that the server has a bug.
    """

    def __init__(self, url, headers, text, campaign, earlier):
        self.url, self._text = url, text
        self._campaign, self._earlier = campaign, earlier
        self._http = httpx.Client(base_url=url, headers=headers, timeout=SILENCE, trust_env=False)
        self.events, self.has_seen_the_end = [], False
        self.kept, self.statuses, self.faults = [], Counter(), []
        self._over = threading.Event()
        self._threads = [threading.Thread(target=each, daemon=True) for each in (self._follow, self._make_entries)]

    def arrive(self):
        """Begin."""
        for thread in self._threads:
            thread.start()

    def leave(self):
        """End; a question that is not answered is waited for."""
        self._over.set()
        for thread in self._threads:
            thread.join(2.0 * SILENCE)
            assert not thread.is_alive()
        self._http.close()

    def ask(self, method, path, **more):
        """Return the answer of the server; None if there is none."""
        try:
            answer = self._http.request(method, path, **more)
        except httpx.TransportError:
            return None
        self.statuses[answer.status_code] += 1
        if answer.status_code == 500:
            self.faults.append(f"{method} {path}: {answer.text}")
        return answer

    def _follow(self):
        """Post the campaign until that is answered, and follow it to its end."""
        body, headers = {"text": self._text, "tags": []}, {"Idempotency-Key": "storm"}
        while not _is_made(self.ask("POST", f"{API}/campaigns", json=body, headers=headers)):
            if self._over.wait(PAUSE):
                return
        last = ""
        while not (self.has_seen_the_end or self._over.is_set()):
            with suppress(httpx.TransportError):
                last = self._hear(last)
            self._over.wait(PAUSE)

    def _hear(self, last):
        """Hear the events after the last one that was seen, as long as the connection holds; return the last id."""
        path, headers = f"{API}/campaigns/{self._campaign}/events", {"Last-Event-ID": last}
        with self._http.stream("GET", path, headers=headers) as answer:
            self.statuses[answer.status_code] += 1
            for event in events_in(answer.iter_lines()) if answer.is_success else ():
                if event.kind == "end":
                    self.has_seen_the_end = True
                elif event.id == last:
                    self.faults.append(f"the event {last} came again")
                else:
                    last = event.id
                    self.events.append(json.loads(event.data))
                if self._over.is_set():
                    break
        return last

    def _make_entries(self):
        """Make users, shared links and sign-offs, each with a name of its own."""
        for number, make in zip(count(), cycle((self._add_user, self._share, self._sign))):
            name = f"entry-{number}"
            if _is_made(make(name)):
                self.kept.append((make.__name__.removeprefix("_"), name))
            if self._over.wait(PAUSE):
                return

    def _add_user(self, name):
        return self.ask("POST", f"{API}/users", json={"name": name, "role": "viewer"})

    def _share(self, name):
        return self.ask("POST", f"{API}/campaigns/{self._earlier}/shares", json={"note": name})

    def _sign(self, name):
        path = f"{API}/campaigns/{self._earlier}/signoffs"
        seen = self.ask("GET", f"{path}/content")
        if seen is None or not seen.is_success:
            return None
        return self.ask("POST", path, json={"content": seen.json()["content"], "comment": name})

    def entries(self):
        """Return kind and name of all entries that the server shows now."""
        home = f"{API}/campaigns/{self._earlier}"
        users = self._all(f"{API}/users", "users", "name", "add_user")
        shares = self._all(f"{home}/shares", "shares", "note", "share")
        return users | shares | self._all(f"{home}/signoffs", "signoffs", "comment", "sign")

    def _all(self, path, listed, key, kind):
        """Return kind and name of what a call lists."""
        answer = self.ask("GET", path, params={"limit": 1000})
        assert answer is not None, f"{path}: no answer"
        assert answer.is_success, answer.text
        return {(kind, each[key]) for each in answer.json()[listed]}


def _is_made(answer):
    return answer is not None and answer.status_code in MADE
