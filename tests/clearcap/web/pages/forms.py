"""Read a page as a browser without scripts does: its forms, and what a reader of screens would miss."""

from html.parser import HTMLParser


class Page(HTMLParser):
    """The forms and faults of a page.

    Attributes
    ----------
    forms : list of dict
        Each with `method`, `action`, and `fields`: name -> value as it stands.
    faults : list of str
        Fields without a label, writes without the session's word, scripts and styles inside the page.
    """

    def __init__(self, text):
        super().__init__()
        self.forms, self.faults, self._labels = [], [], 0
        self.feed(text)
        for form in self.forms:
            if form["method"] == "post" and "csrf" not in form["fields"]:
                self.faults.append(f"form {form['action']} has no csrf")

    def handle_starttag(self, tag, attrs):
        """Note a form, a field, or a fault."""
        given = dict(attrs)
        self.faults += [f"{tag} has {name}" for name in given if name == "style" or name.startswith("on")]
        if tag == "style" or (tag == "script" and "src" not in given):
            self.faults.append(f"inline {tag}")
        if tag == "label":
            self._labels += 1
        if tag == "form":
            self.forms.append({"method": given.get("method", "get"), "action": given["action"], "fields": {}})
        if tag in ("input", "select", "textarea"):
            is_hidden = given.get("type") == "hidden" or "hidden" in given
            if not (self._labels or is_hidden or "aria-label" in given):
                self.faults.append(f"{tag} {given.get('name')} has no label")
            if self.forms and "name" in given:
                self.forms[-1]["fields"][given["name"]] = given.get("value", "")

    def handle_endtag(self, tag):
        """Note the end of a label."""
        if tag == "label":
            self._labels -= 1

    def form(self, action):
        """Return the fields of the form with an action."""
        return next(form["fields"] for form in self.forms if form["action"] == action)
