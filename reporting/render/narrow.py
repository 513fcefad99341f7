"""Tables for narrow screens: each cell has the name of its column, which the style sheet shows instead of the head.

On a telephone a row of a wide table becomes a card, one cell below the other, so that nothing is cut off.
"""

import re

WIDE = 2  # columns; wider tables become cards

_TABLE = re.compile(r"<table\b[^>]*>.*?</table>", re.S)
_ROW = re.compile(r"<tr\b[^>]*>.*?</tr>", re.S)
_CELL = re.compile(r"<(t[dh])\b([^>]*)>(.*?)</\1>", re.S)
_TAG = re.compile(r"<[^>]*>")


def label_cells(page: str) -> str:
    """Return the page with the name of its column added to every cell of wide tables.

    It reads HTML from this package's templates: user input is escaped, so every tag comes from the templates.
    """
    return _TABLE.sub(lambda found: _labelled(found[0]), page)


def _labelled(table: str) -> str:
    """Return a table with labels; a narrow table is returned unchanged."""
    head, end, body = table.partition("</thead>")
    names = _column_names(_ROW.findall(head))
    if len(names) <= WIDE:
        return table
    rows = _ROW.sub(lambda row: _labelled_row(row[0], names), body)
    return _stacked(head) + end + rows


def _stacked(head: str) -> str:
    """Return the opening tag of a table with the class of tables that become cards."""
    tag, _, rest = head.partition(">")
    tag = tag.replace('class="', 'class="stack ') if 'class="' in tag else f'{tag} class="stack"'
    return f"{tag}>{rest}"


def _column_names(rows: list[str]) -> list[str]:
    """Return the name of each column; for a head with two rows, the name of the group and that of the column."""
    names: list[str] = []
    groups: list[tuple[int, int]] = []  # first column and number of columns of each group cell
    for cells in map(_CELL.findall, rows[:1]):
        for _, attributes, content in cells:
            span = _span(attributes)
            groups += [(len(names), span)] if span > 1 else []
            names += [_words(content)] * span
    below = [_words(content) for row in rows[1:2] for _, _, content in _CELL.findall(row)]
    places = [column for first, span in groups for column in range(first, first + span)]
    for column, name in zip(places, below, strict=False):
        names[column] = f"{names[column]} {name}"
    return names


def _labelled_row(row: str, names: list[str]) -> str:
    """Return a row whose cells have the names of their columns; the row heading gets none."""
    column = 0

    def label(cell: re.Match[str]) -> str:
        nonlocal column
        name, column = names[column] if column < len(names) else "", column + _span(cell[2])
        if cell[1] == "th" or not name:
            return cell[0]
        return f'<td{cell[2]} data-label="{name}">{cell[3]}</td>'

    return _CELL.sub(label, row)


def _span(attributes: str) -> int:
    """Return how many columns a cell spans."""
    found = re.search(r'colspan="(\d+)"', attributes)
    return int(found[1]) if found else 1


def _words(content: str) -> str:
    """Return the text of a cell, still escaped, including quotation marks, because it becomes an attribute."""
    return " ".join(_TAG.sub(" ", content).split()).replace('"', "&#34;")
