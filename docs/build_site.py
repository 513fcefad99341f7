"""Build the documentation as a site: `python docs/build_site.py [FOLDER]`, or `make docs`.

The pages are those of the repository, in the order of docs/README.md, whose sections become the navigation. Made here:
the reference of the command from its help, of the service from its routes, of Python from the docstrings, and the keys
of both files from their JSON Schemas. A link without a target is an error, as is everything that Sphinx
warns of. Where the server finds the site (`SITE`), it shows it under Help.
"""

import hashlib
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from typer.main import get_command

import clearcap
from campaign.spec.campaign_file import campaign_schema
from clearcap.cli import app
from clearcap.web.api import routers
from clearcap.web.http.authentication import WHO_MAY
from clearcap.web.pages.rendering import SITE
from engine.mechanism import mechanism_schema

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
INDEX = DOCS / "README.md"
# Pages outside docs/ that pages of docs/ lead to, by their names on the site.
OTHERS = {
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changes.md",
    "CONTRIBUTING.md": "contributing.md",
    "README.md": "overview.md",
    "SECURITY.md": "security-reports.md",
    "deploy/README.md": "deploy.md",
}
GENERATED = {
    "Reference": [f"reference/{name}" for name in ("command", "http-api", "python", "campaign-keys", "mechanism-keys")],
}
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_INLINE = re.compile(r"<(script|style)>(.*?)</\1>", re.S)
_FENCED = re.compile(r"(^```.*?^```)", re.M | re.S)


def pages() -> dict[Path, str]:
    """Return the name on the site of each page."""
    found = {page: page.relative_to(DOCS).as_posix() for page in sorted(DOCS.rglob("*.md"))}
    found[INDEX] = "index.md"
    studies = {page: page.relative_to(ROOT).as_posix() for page in sorted((ROOT / "studies").glob("*.md"))}
    return found | studies | {ROOT / name: there for name, there in OTHERS.items()}


def on_site(page: Path, names: Mapping[Path, str]) -> str:
    """Return the text of a page with its links as they are on the site; links to other files become plain text."""
    here = Path(names[page]).parent

    def moved(link: re.Match[str]) -> str:
        picture, words, address = link.groups()
        path, hash_, anchor = address.partition("#")
        target = (page.parent / path).resolve()
        if "://" in address or not path:
            return link[0]
        if target.is_relative_to(DOCS / "images") or target.is_relative_to(DOCS / "examples"):
            name = target.relative_to(DOCS).as_posix()
        elif target in names:
            name = names[target]
        else:
            return words
        return f"{picture}[{words}]({'../' * len(here.parts)}{name}{hash_}{anchor})"

    pieces = _FENCED.split(page.read_text("utf-8"))  # every second piece is code
    return "".join(piece if i % 2 else _LINK.sub(moved, piece) for i, piece in enumerate(pieces))


def contents(names: Mapping[Path, str]) -> Iterator[str]:
    """Yield the tables of contents, one for each section of the index that lists pages."""
    listed = set[str]()
    for section in re.split(r"^## ", INDEX.read_text("utf-8"), flags=re.M)[1:]:
        title = section.partition("\n")[0]
        links = [(INDEX.parent / link).resolve() for link in re.findall(r"^- \[[^\]]*\]\(([^)#]+)\)", section, re.M)]
        entries = [names[page].removesuffix(".md") for page in links] + GENERATED.get(title, [])
        listed.update(entries)
        if entries:
            yield _toctree(title, entries)
    known = [name.removesuffix(".md") for name in names.values() if name != "index.md"]
    yield _toctree("Project", [name for name in known if name not in listed])


def _toctree(title: str, entries: list[str]) -> str:
    return "\n".join(["", "```{toctree}", ":hidden:", f":caption: {title}", ":maxdepth: 1", "", *entries, "```", ""])


def python_reference() -> str:
    """Return the page of all names that ``import clearcap`` gives."""
    text = ["# Python, name by name", "", "What each name is for: [clearcap in Python](../python.md).", ""]
    for name in clearcap.__all__:
        value = getattr(clearcap, name)
        lines = [f".. autofunction:: clearcap.{name}"]
        if isinstance(value, type):
            lines = [f".. autoclass:: clearcap.{name}"]
            shown = set(dir(value))  # as `help()` shows it
            own = [key for key, member in vars(value).items() if key in shown and _is_documented(key, member, value)]
            lines += ["   :members: " + ", ".join(own)] if own and not issubclass(value, Exception) else []
            lines += ["   :no-index-entry:"] if issubclass(value, Exception) else []
        text += [f"## `{name}`", "", "```{eval-rst}", *lines, "```", ""]
    return "\n".join(text)


def _is_documented(name: str, member: Any, owner: type) -> bool:
    """Return whether a member is a method or property of its own with a docstring."""
    is_field = name in getattr(owner, "model_fields", {}) or name.startswith("_") or name == "model_config"
    return not is_field and bool(getattr(member, "__doc__", None)) and not isinstance(member, str | int | dict | tuple)


def command_reference() -> str:
    """Return the page of all verbs and options, from what ``--help`` prints."""
    text = ["# The command, option by option", "", "What the verbs mean together: [the command](../command.md).", ""]
    for words, verb in _verbs(get_command(app), "clearcap"):
        text += [f"## {words}", "", _markdown(verb.help or ""), "", "| option | meaning |", "| --- | --- |"]
        text += [f"| {_names(parameter)} | {_meaning(parameter)} |" for parameter in verb.params]
        text.append("")
    return "\n".join(text)


def _verbs(command: Any, words: str) -> Iterator[tuple[str, Any]]:
    """Yield each verb that takes options, with the words that call it."""
    if not hasattr(command, "commands"):
        yield words, command
        return
    for name, each in command.commands.items():
        yield from _verbs(each, f"{words} {name}")


def _names(parameter: Any) -> str:
    names = [*parameter.opts, *parameter.secondary_opts]
    return ", ".join(f"`{name if name.startswith('-') else name.upper()}`" for name in names)


def _meaning(parameter: Any) -> str:
    default, text = parameter.default, " ".join((getattr(parameter, "help", None) or "").split())
    is_shown = isinstance(default, str | int | float) and not isinstance(default, bool) and default != ""
    variable = getattr(parameter, "envvar", None)
    return _markdown(text) + (f" Default: {f'`{variable}`, else ' if variable else ''}`{default}`." if is_shown else "")


def _markdown(text: str) -> str:
    """Return a help text with options as code, and nothing else taken for markup."""
    return re.sub(r"(?<![\w-])--[\w-]+", r"`\g<0>`", re.sub(r"([|<*\[\]])", r"\\\1", text))


def http_reference() -> str:
    """Return the page of all calls of the service, and each of them with curl."""
    text = ["# The HTTP API, call by call", "", "What the calls mean together: [the service](../service.md).", ""]
    for router in routers():
        text += [
            f"## {str(router.tags[0]).capitalize()}",
            "",
            "| call | what it does | who may |",
            "| --- | --- | --- |",
        ]
        for route in router.routes:
            call = f"`{' '.join([*sorted(route.methods), route.path])}`"
            text.append(f"| {call} | {_markdown(route.summary)} | {route.openapi_extra[WHO_MAY]} |")
        text.append("")
    return "\n".join(
        [*text, "## With curl", "", "```sh", (DOCS / "examples" / "api.sh").read_text("utf-8").rstrip(), "```", ""]
    )


def key_reference(title: str, page: str, schema: Mapping[str, Any]) -> str:
    """Return the page of all keys of a file, table by table, from its JSON Schema."""
    text = [f"# {title}", "", f"Made from the JSON Schema; what the keys mean together: [{page}](../{page}.md).", ""]
    for name, table in {"The file": schema, **schema["$defs"]}.items():
        keys = table.get("properties", {})
        if not keys:
            continue
        text += [f"## {name}", "", " ".join(str(table.get("description", "")).split()).replace("|", r"\|"), ""]
        text += ["| key | what it takes | default | meaning |", "| --- | --- | --- | --- |"]
        needed = table.get("required", [])
        text += [f"| `{key}` | {_kind(of)} | {_default(key, of, needed)} | {_cell(of)} |" for key, of in keys.items()]
        text.append("")
    return "\n".join(text)


def _kind(schema: Mapping[str, Any]) -> str:
    """Return what a key takes, in words."""
    if "$ref" in schema:
        return schema["$ref"].rpartition("/")[2]
    if choices := schema.get("anyOf") or schema.get("oneOf") or schema.get("allOf"):
        return " or ".join(dict.fromkeys(_kind(each) for each in choices if each.get("type") != "null"))
    if "const" in schema or "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema.get("enum", [schema.get("const")]))
    if schema.get("type") == "array":
        return f"list of {_kind(schema['items'])}" if isinstance(schema.get("items"), Mapping) else "list"
    if schema.get("type") == "object":
        inner = schema.get("additionalProperties")
        return f"table of {_kind(inner)}" if isinstance(inner, Mapping) else "table"
    return str(schema.get("type", "anything"))


def _default(key: str, schema: Mapping[str, Any], needed: list[str]) -> str:
    value = schema.get("default")
    if key in needed:
        return "needed"
    return f"`{value}`" if isinstance(value, str | int | float) and value != "" else ""


def _cell(schema: Mapping[str, Any]) -> str:
    return " ".join(str(schema.get("description", "")).split()).replace("|", r"\|").replace("<", r"\<")


def write_sources(folder: Path) -> None:
    """Write all pages of the site into a folder."""
    names = pages()
    texts = {name: on_site(page, names) for page, name in names.items()}
    texts["index.md"] += "".join(contents(names))
    texts |= {
        "reference/command.md": command_reference(),
        "reference/http-api.md": http_reference(),
        "reference/python.md": python_reference(),
        "reference/campaign-keys.md": key_reference("Keys of the campaign file", "campaign", campaign_schema()),
        "reference/mechanism-keys.md": key_reference("Keys of the mechanism file", "mechanism", mechanism_schema()),
    }
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, "utf-8")
    for kept in ("images", "examples"):
        shutil.copytree(DOCS / kept, folder / kept)


def without_inline_code(built: Path) -> None:
    """Move scripts and styles in the pages of the theme to files: the server's content policy allows no others."""
    for page in built.rglob("*.html"):
        up = "../" * (len(page.relative_to(built).parts) - 1)

        def moved(found: re.Match[str], up: str = up) -> str:
            kind, code = found.groups()
            name = f"_static/{hashlib.sha256(code.encode()).hexdigest()[:12]}.{'js' if kind == 'script' else 'css'}"
            (built / name).write_text(code, "utf-8")
            if kind == "script":
                return f'<script src="{up}{name}"></script>'
            return f'<link rel="stylesheet" type="text/css" href="{up}{name}" />'

        page.write_text(_INLINE.sub(moved, page.read_text("utf-8")), "utf-8")


def build(target: Path) -> int:
    """Build the site in place of what is there; return the exit status of Sphinx, 0 without a warning."""
    from sphinx.cmd.build import main

    with tempfile.TemporaryDirectory(prefix="clearcap-docs-") as temporary:
        source, built = Path(temporary, "source"), Path(temporary, "built")
        write_sources(source)
        options = ["--fail-on-warning", "--keep-going", "--quiet", "--conf-dir", str(DOCS), "--builder", "html"]
        status = main([*options, "--doctree-dir", f"{temporary}/doctrees", str(source), str(built)])
        if not status:
            without_inline_code(built)
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(built, target, ignore=shutil.ignore_patterns(".buildinfo", "objects.inv"))
    return status


if __name__ == "__main__":
    sys.exit(build(Path(sys.argv[1]) if len(sys.argv) > 1 else SITE))
