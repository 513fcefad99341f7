"""Help of the command: options without a value show no type, and paragraphs fill the width of the terminal."""

from typing import Any

import typer
from typer.core import TyperGroup


class Group(TyperGroup):
    """A group of verbs whose help, and that of each of its verbs, is tidied."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        _tidy(self)

    def get_command(self, ctx: typer.Context, cmd_name: str) -> Any:  # type: ignore[override]  # typer's own context
        """Return the verb of that name, or None."""
        command = super().get_command(ctx, cmd_name)
        if command is not None:
            _tidy(command)
        return command


def _tidy(command: Any) -> None:
    """Leave out what Typer adds to options without a value, and line breaks of the docstring within a paragraph."""
    # the option --help is made when it is first asked for, and then kept
    for option in (*command.params, command.get_help_option(typer.Context(command))):
        if getattr(option, "is_flag", False):
            option.metavar = ""  # from 0.29 on, Typer writes <bool> behind an option without a value
    if command.help:
        command.help = "\n\n".join(" ".join(part.split()) for part in command.help.split("\n\n"))
